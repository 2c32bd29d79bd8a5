"""What `probe`, `selftest` and `baseline` say at their end: the next line to type."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmfts.cli import direct, next_step
from fmfts.cli.main import main
from fmfts.common import exit_codes
from fmfts.view.facts import print_facts

CONFIG = """
[[pad]]
name = "left"
[pad.source]
type = "simulated"
finger = "none"
"""


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("FMFTS_BUS", f"ipc://{tmp_path}")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    (tmp_path / "pad.toml").write_text(CONFIG)
    return str(tmp_path / "pad.toml")


def test_each_verb_of_the_first_use_names_the_next(config: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Whoever types what is said, ends at run."""
    said = []
    for words in (
        ["probe"],
        ["selftest"],
        ["baseline", "--bare", "--duration-s", "1"],
        ["baseline", "--rest", "--duration-s", "1"],
    ):
        assert main([*words, "--config", config]) == 0
        said.append(capsys.readouterr().out.splitlines()[-1])
    for line, command in zip(said, ("selftest", "baseline --bare", "baseline --rest", "run"), strict=True):
        assert line.startswith("next: ")
        assert f"`fmfts-daemon {command} --config {config}`" in line


def test_json_output_holds_facts_only(config: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["probe", "--json", "--config", config]) == 0
    assert "next" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "variable", "pad"),
    [
        ((), "", None),
        ((), "pad.toml", "left"),
        (("--config", "pad.toml"), "", "left"),
        (("--pad", "x"), "", "x"),
        (("--pad", "x"), "pad.toml", "x"),
    ],
)
def test_file_that_only_lies_here_names_no_pad_of_a_running_daemon(
    config: str, words: tuple[str, ...], variable: str, pad: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.chdir(Path(config).parent)
    monkeypatch.setenv("FMFTS_CONFIG", variable)
    monkeypatch.setattr(direct, "ask_daemon", lambda verb, base, pad, **_: asked.append(pad) or {"pad": "right"})
    assert main(["selftest", *words]) == 0
    assert asked == [pad]


def test_probe_of_one_pad_is_of_that_pad_alone(config: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(config).write_text(CONFIG + CONFIG.replace("left", "right"))
    assert main(["probe", "--pad", "right", "--config", config]) == 0
    said = capsys.readouterr().out
    assert "pad: right" in said
    assert "left" not in said
    assert f"`fmfts-daemon selftest --config {config} --pad right`" in said
    assert main(["probe", "--pad", "rigth", "--config", config]) == 2
    assert "did you mean 'right'?" in capsys.readouterr().err


def test_unusable_recording_is_reported_before_run(config: str, capsys: pytest.CaptureFixture[str]) -> None:
    recording = Path(__file__).parents[1] / "data/recordings/taps.mcap"
    replayed = f'[[pad]]\nname = "left"\n[pad.source]\ntype = "replay"\nfile = "{recording}"\n'
    Path(config).write_text(replayed)
    assert main(["check-config", "--config", config]) == 0
    Path(config).write_text(replayed + 'chip = "mmc5983ma"\n')
    assert main(["check-config", "--config", config]) == 78
    assert 'was recorded with chip = "hmc5983": set it in [pad.source]' in capsys.readouterr().err


@pytest.mark.parametrize(
    ("could_gain", "offered"),
    [(["selftest: ±9 µm", "--turn: ±8 µm", "--refine: ±7 µm"], "--turn"), (["--refine: ±7 µm"], "--refine"), ([], "")],
)
def test_turning_and_pressing_are_offered_only_while_they_would_help(could_gain: list[str], offered: str) -> None:
    told = next_step.after_baseline({"kind": "rest", "could_gain": could_gain}, "", "", is_running=False)
    assert told.startswith("`fmfts-daemon run`")
    running = next_step.after_baseline({"kind": "rest", "could_gain": could_gain}, "", "", is_running=True)
    assert "fmfts-daemon run`" not in running
    assert (f"baseline {offered}`" in told) if offered else ("baseline" not in told)


def test_pad_that_is_absent_or_faulty_is_named_with_what_to_do() -> None:
    pads = [{"pad": "a", "connected": True, "faults": []}, {"pad": "b", "connected": False, "faults": []}]
    assert "source of pad 'b' answer: the `reason` of each says how" in next_step.after_probe({"pads": pads}, "")
    for connected in (True, False):  # a known fault must be mended first, even where it stops all frames
        pads[1] |= {"connected": connected, "faults": ["sensor 3: silent"]}
        assert "under faults of pad 'b'" in next_step.after_probe({"pads": pads}, "")
    both = next_step.after_probe({"pads": [pads[0] | {"connected": False}, pads[1]]}, "")
    assert "source of pad 'a' answer" in both
    assert "under faults of pad 'b'" in both
    pads[1] |= {"connected": True}
    pads[1] |= {"faults": []}
    assert "selftest --config x.toml --pad a`" in next_step.after_probe({"pads": pads}, " --config x.toml")
    assert "sensors that failed" in next_step.after_selftest({"passed": False}, "", "")


def test_gains_of_a_recording_are_reported_in_words_with_units(capsys: pytest.CaptureFixture[str]) -> None:
    facts = {
        "was_gain_sd": 0.05,
        "was_press_1n_force_sd_n": 0.071,
        "was_press_1n_sideways_sd_m": 3e-4,
        "was_sensor_place_sd_m": 1e-4,
        "now_gain_sd": 0.003,
        "now_press_1n_force_sd_n": 0.018,
        "now_press_1n_sideways_sd_m": 7e-5,
        "now_sensor_place_sd_m": 9e-5,
    }
    print_facts(facts, as_json=False)
    assert capsys.readouterr().out.splitlines() == [
        "gains, relative to each other: ± 0.0030 (was ± 0.0500)",
        "press of 1 N: force, without the silicone's stiffness: ± 0.018 N (was ± 0.071 N)",
        "press of 1 N: magnet's way sideways: ± 0.070 mm (was ± 0.300 mm)",
        "places of the sensors: ± 0.090 mm (was ± 0.100 mm)",
    ]


def test_found_on_bus_does_not_repeat_why_a_bus_is_absent(config: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(config).write_text('[[pad]]\nname = "left"\n[pad.source]\ntype = "i2c"\nbus = 4711\n')
    assert main(["probe", "--config", config]) == exit_codes.UNAVAILABLE
    said = capsys.readouterr().out
    assert "reason: /dev/i2c-4711 does not exist" in said
    assert "found on bus" not in said
