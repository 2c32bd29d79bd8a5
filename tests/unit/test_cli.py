"""The command: what it tells a stranger who gets a verb wrong, and where to read on."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import NoReturn, get_args

import pytest

from fmfts.bus.messages import Health
from fmfts.cli import elsewhere
from fmfts.cli.elsewhere import OF_OPTION
from fmfts.cli.main import EPILOG, main
from fmfts.cli.verb import VerbError
from fmfts.common import exit_codes, extras
from fmfts.common.extras import LABORATORY, how_to_install
from fmfts.common.toml import parse
from fmfts.config import model_kinds
from fmfts.contact.shipped import DEFAULT_PATH

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "config.toml"
CALIBRATION = ROOT / "tests" / "data" / "calibration_1.23T.csv"
CODES = list(exit_codes.MEANING)


def changed(folder: Path, before: str, after: str) -> str:
    text = SHIPPED.read_text()
    assert before in text
    (folder / "pad.toml").write_text(text.replace(before, after))
    return str(folder / "pad.toml")


def test_check_config_says_what_each_pad_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-config", "--config", str(SHIPPED)]) == 0
    assert re.fullmatch(
        rf"good: 1 pad in {SHIPPED}\ndemo: simulated, 220 Hz, contact model [0-9a-f]{{12}}…\n", capsys.readouterr().out
    )


def test_check_config_refuses_model_of_another_pad_as_run_would(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = changed(tmp_path, "rest_mm = [0, 0, 12]", "rest_mm = [0, 0, 11]")
    text = Path(config).read_text()
    Path(config).write_text(text.replace('model = "default"', f'model = "{DEFAULT_PATH}"'))
    assert main(["check-config", "--config", config]) == exit_codes.CONFIG
    said = capsys.readouterr().err
    assert said.startswith("fmfts-daemon check-config: contact model ")
    assert "was trained for a pad of other dimensions" in said
    assert "magnet.rest_mm is 0, 0, 12 in the model and 0, 0, 11 in the configuration" in said
    assert "sensors_mm" not in said.split("configuration")[0]


def test_check_config_says_that_shear_is_excluded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = changed(tmp_path, 'model = "default"', 'model = "shear"')
    text = Path(config).read_text()
    assert main(["check-config", "--config", config]) == 0
    assert "friction" not in capsys.readouterr().err
    Path(config).write_text(re.sub(r"(?m)^friction = [^ ]*", "friction = 0.0", text))
    assert main(["check-config", "--config", config]) == 0
    assert "warning: [pad.contact] friction = 0 excludes shear" in capsys.readouterr().err


SLOW_LOG = """
import sys, time, types
import fmfts.service.log
fmfts.service.log.select = types.SimpleNamespace(select=lambda *_: time.sleep(0.3))
from fmfts.cli.main import main
sys.exit(main(["run", "--config", sys.argv[1]]))
"""


def test_last_line_says_why_the_daemon_ended_despite_a_slow_log(tmp_path: Path) -> None:
    """A thread writes the log. `report` and the demo show its end to whoever asks for why."""
    (tmp_path / "own.onnx").write_text("no model")
    config = changed(tmp_path, 'model = "default"', 'model = "own.onnx"')
    ended = subprocess.run([sys.executable, "-c", SLOW_LOG, config], capture_output=True, text=True, check=False)
    assert ended.returncode == exit_codes.CONFIG
    lines = ended.stderr.splitlines()
    assert len(lines) > 1, "the log has a line of its own"
    assert lines[-1].startswith("fmfts-daemon run: contact model ")


def test_absent_package_comes_with_the_line_that_installs_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "fmfts_calibrate.command", None)
    arguments = ["calibrate", str(CALIBRATION), "-o", "m.onnx", "--config", str(SHIPPED)]
    assert main(arguments) == exit_codes.LACKING
    assert f"{sys.executable} -m pip install 'fmfts[calibrate]'" in capsys.readouterr().err


def test_finite_elements_without_felupe_name_its_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "felupe", None)
    assert main(["pad-model", "--config", str(SHIPPED), "-o", str(tmp_path / "p.npz")]) == exit_codes.LACKING
    said = capsys.readouterr().err
    assert "felupe, a package under GPL-3" in said
    assert f"{sys.executable} -m pip install 'fmfts[fem]'" in said


def test_package_missing_after_no_deps_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.startswith(("fmfts_recording.", "mcap"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mcap", None)
    assert main(["replay", "touch.mcap"]) == exit_codes.LACKING
    said = capsys.readouterr().err
    assert "mcap" in said
    assert f"{sys.executable} -m pip install 'fmfts[recording]'\n" in said


@pytest.mark.parametrize(
    "words",
    [("listen", "--seconds=-1"), ("record", "a.mcap", "--seconds=nan"), ("baseline", "--rest", "--duration-s=0")],
)
def test_invalid_time_is_refused_as_usage(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == exit_codes.USAGE
    assert "must be more than 0 seconds" in capsys.readouterr().err


def test_reader_that_leaves_is_no_error() -> None:
    command = [sys.executable, "-m", "fmfts", "pose", str(CALIBRATION), "--config", str(SHIPPED)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(60) == 141


ONE_THREAD = """
import sys
from contextlib import suppress
from fmfts.cli.entry import main
sys.argv[1:] = ["--help"]
with suppress(SystemExit):
    main()
import numpy
from threadpoolctl import threadpool_info
print(*(library["num_threads"] for library in threadpool_info()), file=sys.stderr)
"""


def test_verb_computes_on_one_core() -> None:
    """OpenBLAS would take all cores for matrices whose sizes do not pay it."""
    free = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    ended = subprocess.run([sys.executable, "-c", ONE_THREAD], env=free, capture_output=True, text=True, check=True)
    assert set(ended.stderr.split()) <= {"1"}


@pytest.mark.parametrize("place", ["--help", "docs/troubleshooting.md"])
def test_every_exit_code_is_explained(place: str, capsys: pytest.CaptureFixture[str]) -> None:
    if place == "--help":
        with pytest.raises(SystemExit):
            main([place])
        text = capsys.readouterr().out
    else:
        text = (ROOT / place).read_text()
    assert [code for code in CODES if not re.search(rf"\b{code}\b", text)] == []


@pytest.mark.parametrize("step", ["init", "probe", "selftest", "--bare", "--rest", "--turn", "weigh", "run"])
def test_help_and_readme_name_each_step_of_a_first_use(step: str) -> None:
    steps = EPILOG.partition(". If a daemon")[0]
    assert re.search(rf"(?<!\w){step}\b", steps)
    listed = (ROOT / "README.md").read_text().partition("## Use your own pad")[2].partition("## As a service")[0]
    assert re.search(rf"^    fmfts-daemon (baseline )?{step}\b", listed, flags=re.MULTILINE)


def test_every_word_of_health_comes_with_what_to_do() -> None:
    text = (ROOT / "docs/troubleshooting.md").read_text()
    assert [word for word in get_args(Health) if word != "ok" and f"\n| `{word}` |" not in text] == []


def test_verb_of_the_laboratory_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: ())
    for words in (
        ["study", "speed-accuracy", "--out", "x"],
        ["pad-model", "-o", "pad.npz"],
        ["pad-model", "--to", "x"],
    ):
        assert main(words) == exit_codes.LACKING
        assert (
            f"pip install -e {ROOT}/extras/simulation -e {ROOT}/extras/calibrate -e {ROOT}/lab\n"
            in capsys.readouterr().err
        )


def test_verb_of_an_extra_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: ())
    assert main(["collect", "simulation", "-o", "data.csv", "--by-hand"]) == exit_codes.LACKING
    assert (
        f"pip install 'fmfts[collect]' -e {ROOT}/extras/recording -e {ROOT}/extras/collect\n" in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    "words", [["calibrate", "data.csv", "-o", "m.onnx"], ["evaluate", "data.csv"], ["pose", "f.csv"]]
)
def test_each_verb_about_models_says_how_to_install_it(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without(monkeypatch, "fmfts.verbs")
    assert main(words) == exit_codes.LACKING
    line = f"pip install 'fmfts[calibrate]' -e {ROOT}/extras/simulation -e {ROOT}/extras/calibrate\n"
    assert line in capsys.readouterr().err


OPTIONS_OF_EXTRAS = [("init --learn", "calibrate"), ("baseline --learn", "calibrate"), ("probe --magnet", "magnet")]


@pytest.mark.parametrize(("words", "extra"), OPTIONS_OF_EXTRAS)
def test_option_of_an_extra_says_how_to_install_it(
    words: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without(monkeypatch, "fmfts.options")
    file = tmp_path / "absent.toml" if words.startswith("init") else SHIPPED
    assert main([*words.split(), "--config", str(file)]) == exit_codes.LACKING
    assert not (tmp_path / "absent.toml").exists()
    said = capsys.readouterr().err
    assert said.startswith(f"fmfts-daemon {words.split()[0]}: {words} belongs to a package of its own")
    beside = f"-e {ROOT}/extras/simulation " if extra == "calibrate" else ""
    assert f"pip install 'fmfts[{extra}]' {beside}-e {ROOT}/extras/{extra}\n" in said


@pytest.mark.parametrize("words", OF_OPTION)
def test_help_marks_options_whose_extra_is_absent(
    words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    verb, option = words.split()
    assert "(not installed)" not in helped(verb, option, capsys)
    without(monkeypatch, OF_OPTION[words][0])
    assert "(not installed)" in helped(verb, option, capsys)
    assert "(not installed)" not in helped(verb, "--config", capsys)


def helped(verb: str, option: str, capsys: pytest.CaptureFixture[str]) -> str:
    """The help of one option."""
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    text = capsys.readouterr().out.partition("options:")[2]
    (said,) = [part for part in re.split(r"\n  (?=-)", text) if part.split()[:1] == [option]]
    return " ".join(said.split())


def without(monkeypatch: pytest.MonkeyPatch, *groups: str) -> None:
    """Hide these entry points, as if no package had them."""
    monkeypatch.setattr(
        "importlib.metadata.entry_points", lambda **of: () if of["group"] in groups else entry_points(**of)
    )


@pytest.mark.parametrize("package", ["calibrate", "collect", "fleet", "foxglove", "page", "report", "skin", LABORATORY])
def test_line_that_installs_a_package_names_all_folders_that_pip_needs(package: str) -> None:
    """pip finds them nowhere else: no index has them."""
    editable, plain = how_to_install(package), how_to_install(package, ROOT / "no-checkout")
    folder = ROOT / package if package == LABORATORY else ROOT / "extras" / package
    needed = parse((folder / "pyproject.toml").read_text())["project"]["dependencies"]
    beside = {word.partition("==")[0].removeprefix("fmfts-") for word in needed if word.startswith("fmfts-")}
    for name in beside - {"client"}:
        assert f"-e {ROOT}/extras/{name} " in editable
        assert f"./extras/{name} " in plain
    assert f"-e {folder}" in editable
    assert plain.endswith(f" ./{folder.relative_to(ROOT)}")


@pytest.mark.parametrize("lacks", ["the package", "mcap"])
def test_replayed_source_says_how_to_install_its_package(
    lacks: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if lacks == "mcap":
        monkeypatch.delitem(sys.modules, "fmfts_recording.source", raising=False)
        monkeypatch.setitem(sys.modules, "mcap", None)
        for name in [name for name in sys.modules if name.startswith(("mcap.", "fmfts_recording"))]:
            monkeypatch.delitem(sys.modules, name)
    else:
        without(monkeypatch, "fmfts.recordings")
    played, config = tmp_path / "a.mcap", tmp_path / "a.toml"
    played.touch()
    config.write_text(f'[[pad]]\nname = "a"\nsource = {{ type = "replay", file = "{played}" }}\n')
    for words in (["check-config"], ["probe"]):
        assert main([*words, "--config", str(config)]) == exit_codes.LACKING
        said = capsys.readouterr().err
        assert f"pip install 'fmfts[recording]' -e {ROOT}/extras/recording\n" in said
        assert ("the source 'replay': package fmfts-recording lacks module mcap; it belongs to" in said) == (
            lacks == "mcap"
        )


def test_simulated_source_and_the_demo_say_how_to_install_their_package(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without(monkeypatch, "fmfts.simulations", "fmfts.verbs")
    of = ["--config", str(SHIPPED)]
    for words in (["check-config", *of], ["probe", *of], ["demo"]):
        assert main(words) == exit_codes.LACKING
        assert f"pip install 'fmfts[simulation]' -e {ROOT}/extras/simulation\n" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["check-config", "probe"])
def test_simulation_of_another_version_is_named(
    verb: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """pip installed this package anew and an extra not: each of these verbs ended with a traceback."""
    old = EntryPoint("source", "fmfts_simulation.fed:what_was_there_once", "fmfts.simulations")
    monkeypatch.setattr(extras, "entry_points_of", lambda group: [old] if group == old.group else ())
    assert main([verb, "--config", str(SHIPPED)]) == exit_codes.LACKING
    said = capsys.readouterr().err
    assert "the source 'simulated': its package does not fit this version: " in said
    assert f"pip install 'fmfts[simulation]' -e {ROOT}/extras/simulation\n" in said


@pytest.mark.parametrize("verb", ["check-config", "run"])
def test_broken_package_of_a_contact_model_is_no_bad_configuration(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.toml").write_text(
        '[[pad]]\nname = "a"\nsource = { type = "anyskin", port = "/dev/null" }\ncontact = { model = "a.response" }\n'
    )

    def load(point: EntryPoint) -> NoReturn:
        raise AttributeError(f"module '{point.module}' has no attribute '{point.attr}'")

    (point,) = entry_points(group=model_kinds.MODELS, name="response")
    monkeypatch.setattr(extras, "entry_points_of", lambda group: [point] if group == point.group else ())
    monkeypatch.setattr(EntryPoint, "load", load)
    model_kinds._added.cache_clear()
    assert main([verb, "--config", str(tmp_path / "a.toml")]) == exit_codes.LACKING
    said = capfd.readouterr().err
    assert "contact models '.response': package fmfts-skin does not fit this version: " in said
    assert "'fmfts_skin.kinds' has no attribute 'RESPONSES'" in said
    assert "pip install 'fmfts[skin]' -e " in said


WITHOUT_SIMULATION = """
import importlib.metadata, sys
importlib.metadata.entry_points = lambda **_: ()
from fmfts.cli.main import main
sys.exit(main(["run", "--config", sys.argv[1]]))
"""


@pytest.mark.parametrize("kind", ["simulated", "replay"])
def test_run_without_the_package_of_a_source_ends(kind: str, tmp_path: Path) -> None:
    """Not as a recording that cannot be read, nor as a bad configuration."""
    (tmp_path / "a.mcap").touch()
    (tmp_path / "pad.toml").write_text(
        f'[bus]\nendpoint = "ipc://{tmp_path}/bus"\n[[pad]]\nname = "a"\nsource = {{ type = "{kind}"'
        + (', file = "a.mcap" }' if kind == "replay" else " }")
    )
    words = [sys.executable, "-c", WITHOUT_SIMULATION, str(tmp_path / "pad.toml")]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ended.returncode == exit_codes.LACKING
    assert f"run: the source '{kind}' belongs to a package of its own; install it with" in ended.stderr


@pytest.mark.parametrize("column", ["force_z_n", "depth_mm", "shear_n"])
def test_data_set_of_an_extra_says_how_to_install_it(
    column: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "set.csv"
    data.write_text(f"b1x_ut,b1y_ut,b1z_ut,{column}\n")
    without(monkeypatch, "fmfts.calibrations")
    assert main(["calibrate", str(data), "-o", str(tmp_path / "model")]) == exit_codes.LACKING
    said = capsys.readouterr().err
    assert column in said
    assert "pip install 'fmfts[skin]' -e " in said


@pytest.mark.parametrize("mark", ["fmfts field response 1", "fmfts force model 1"])
def test_model_of_an_extra_says_how_to_install_it(
    mark: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "model"
    model.write_text(mark)
    without(monkeypatch, "fmfts.calibrations")
    assert main(["evaluate", str(tmp_path / "set.csv"), "--model", str(model)]) == exit_codes.LACKING
    assert "pip install 'fmfts[skin]' -e " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("word", "meant"),
    [("baselin", "baseline"), ("calibrat", "calibrate"), ("stauts", "status"), ("pad-modle", "pad-model")],
)
def test_mistyped_verb_names_the_nearest(word: str, meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([word, "--rest"])
    assert ended.value.code == exit_codes.USAGE
    assert f"there is no verb '{word}'; did you mean {meant}?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("baseline", "--restt"), "there is no option --restt; did you mean --rest?"),
        (("weigh", "--padd=left"), "there is no option --padd; did you mean --pad?"),
        (("baseline", "--xyzzy"), "one of the arguments --bare --rest"),
        (("status", "--xyzzy"), "unexpected: --xyzzy"),
    ],
)
def test_mistyped_option_names_the_nearest(
    words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == exit_codes.USAGE
    assert said in capsys.readouterr().err


def test_word_like_no_verb_lists_them_all(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["xyzzy"])
    assert "the verbs are run, " in capsys.readouterr().err


def test_package_of_another_version_stops_no_other_verb(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """pip installed this package anew and an extra not: each verb of every extra ended with a traceback."""
    wrong, right = "fmfts.cli.verb:what_was_there_once", "fmfts_simulation.demo:add_to"
    points = [EntryPoint("calibrate", wrong, elsewhere.VERBS), EntryPoint("demo", right, elsewhere.VERBS)]
    monkeypatch.setattr(elsewhere, "entry_points_of", lambda group: points if group == elsewhere.VERBS else ())
    assert main(["demo", "--fingers", "2"]) == exit_codes.USAGE
    assert main(["calibrate", "set.csv"]) == exit_codes.LACKING
    assert "calibrate belongs to a package of its own; install it" in capsys.readouterr().err
    assert "the verb 'calibrate' is left out: its package does not fit this version" in caplog.text


def test_dependency_of_a_package_that_is_missing_is_named(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """After `pip install --no-deps` it is no other version."""
    monkeypatch.setitem(sys.modules, "scipy", None)
    points = [EntryPoint("calibrate", "scipy:add_to", elsewhere.VERBS)]
    monkeypatch.setattr(elsewhere, "entry_points_of", lambda group: points if group == elsewhere.VERBS else ())
    assert main(["calibrate", "set.csv"]) == exit_codes.LACKING
    assert "the verb 'calibrate' is left out: its package lacks module scipy" in caplog.text
    points[0] = EntryPoint("calibrate", "scipy:learn", elsewhere.OPTIONS)
    monkeypatch.setattr(extras, "entry_points_of", lambda _: points)
    with pytest.raises(VerbError, match=r"^baseline --learn: its package lacks module scipy; it belongs to a package"):
        elsewhere.option("baseline --learn")
