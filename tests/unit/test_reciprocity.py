"""Maxwell–Betti against the finite elements that it is made of, and a pad model from a command to a pad that moves."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fmfts.cli.main import main
from fmfts.common.exit_codes import DATA, USAGE
from fmfts.config.file import ConfigError, load
from fmfts.sensor.source import SourceError
from fmfts_calibrate.sweep import Workers
from fmfts_lab.finite_elements.finite_element import PressedSlab
from fmfts_lab.finite_elements.pad_file import write_pad_file
from fmfts_lab.finite_elements.reciprocity import Influence
from fmfts_lab.finite_elements.slab import Press, Slab
from fmfts_lab.finite_elements.solved_presses import solve_into
from fmfts_simulation.pad_file import read_pad_file
from fmfts_simulation.solved_table import PRESSED_PATH, RESPONSE, SI, read_solved
from fmfts_simulation.source import Simulated

pytestmark = pytest.mark.needs(felupe="fem")
ELEMENT_M = 2e-3
COARSE = ("--element-mm", "2")


@cache
def influence() -> Influence:
    return Influence.of(Slab(), ELEMENT_M)


@pytest.mark.parametrize("load_n", [(0.0, 0.0, -0.01), (0.007, -0.004, -0.01), (0.0, 0.01, 0.0)])
def test_light_loads_move_the_magnet_as_reciprocity_says(load_n: tuple[float, float, float]) -> None:
    """At 10 mN the solid is linear to a thousandth: strains are some 1e-3."""
    slab = PressedSlab(Slab(), ELEMENT_M)
    displacement_m, axis = slab.solve(Press(5e-3, -3e-3, -load_n[2], *load_n[:2]))
    expected = np.array(load_n) @ influence().of_patch(5e-3, -3e-3)
    np.testing.assert_allclose(displacement_m, expected[:3], atol=2e-3 * np.linalg.norm(displacement_m))
    np.testing.assert_allclose(axis[:2], expected[3:], atol=2e-3 * np.linalg.norm(axis[:2]))


COARSE_M = 4e-3  # the test compares processes, not meshes


def test_reciprocity_errs_below_two_and_a_half_percent_at_0_3_n() -> None:
    """Of the finite strain of 1 mm elements, which the shipped presses are: 2.3 % at 0.3 N, in proportion below."""
    rows = read_solved(PRESSED_PATH)
    rows = rows[rows[:, 2] == 0.3]
    table = Influence.of(Slab()).mechanics()
    error = table.response(rows[:, 0] * 1e-3, rows[:, 1] * 1e-3, rows[:, 2]) - rows[:, RESPONSE] * SI
    way = np.linalg.norm(rows[:, 5:8], axis=1) * 1e-6
    assert (np.linalg.norm(error[:, :3], axis=1) < 0.025 * way).all()
    assert np.linalg.norm(error[:, 3:], axis=1).max() < 0.02 * np.linalg.norm(rows[:, 8:], axis=1).max()


def test_table_is_the_patch_at_its_nodes() -> None:
    reach_m = influence().slab.reach_m
    table = influence().mechanics()
    for x_m, y_m in ((0.0, 0.0), (3e-3, -5e-3), (reach_m, reach_m)):
        press = [np.array([value]) for value in (x_m, y_m, 0.2, 0.05, -0.1)]
        expected = np.array([0.05, -0.1, -0.2]) @ influence().of_patch(x_m, y_m)
        np.testing.assert_allclose(table.response(*press)[0], expected, rtol=1e-9, atol=1e-15)


def test_command_makes_a_pad_that_reads_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Half as stiff, twice as far: the solid is linear in its moduli."""
    far = []
    for name, share in (("stiff", 1.0), ("soft", 0.5)):
        target = tmp_path / f"{name}.npz"
        moduli = ("--c10-mpa", f"{share * 0.2}", "--c01-mpa", f"{share * 0.05}", "--bulk-mpa", f"{share * 20}")
        assert main(["pad-model", "--config", "config.toml", "-o", str(target), *COARSE, *moduli]) == 0
        assert target.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"
        mechanics, slab = read_pad_file(target)
        assert slab["c10_pa"] == pytest.approx(share * 0.2e6)
        far.append(mechanics.response(np.array([4e-3]), np.array([1e-3]), np.array([0.3])))
    np.testing.assert_allclose(far[1], 2.0 * far[0], rtol=1e-6)
    assert "set [pad.source] mechanics to it" in capsys.readouterr().out


def test_impossible_pad_is_refused_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["pad-model", "--config", "config.toml", "-o", str(tmp_path / "p.npz"), "--thickness-mm", "1"]) == USAGE
    assert "does not lie inside a slab of 1 mm" in capsys.readouterr().err


def test_damaged_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "pad.npz"
    write_pad_file(path, influence().mechanics(), Slab())
    whole = path.read_bytes()
    for damaged in (b"", b"not a zip", whole[: len(whole) // 2]):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match="is not a pad model"):
            read_pad_file(path)


def simulated(tmp_path: Path, magnet: str = "") -> Simulated:
    file = tmp_path / "config.toml"
    file.write_text(
        '[[pad]]\nname = "soft"\n[pad.source]\ntype = "simulated"\nmechanics = "pad.npz"\n[pad.magnet]\n' + magnet
    )
    config, _ = load(file)
    return Simulated(config.pad[0], perfect=True)


def test_simulated_pad_moves_as_its_file_says(tmp_path: Path) -> None:
    table = influence().mechanics()
    write_pad_file(tmp_path / "pad.npz", table, Slab())
    press = [np.array([value]) for value in (5e-3, -2e-3, 0.4)]
    built = simulated(tmp_path).built
    position_m, axis = built.pose(*press)
    displacement_m, expected_axis = table.displacement(*press)
    np.testing.assert_array_equal(position_m, built.pad.rest_position_m + displacement_m)
    np.testing.assert_array_equal(axis, expected_axis)


def test_unusable_pad_file_is_named_with_a_remedy(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"source.mechanics.*`fmfts-daemon pad-model -o PAD.npz` makes one"):
        simulated(tmp_path)
    (tmp_path / "pad.npz").write_text("x_mm,y_mm")
    with pytest.raises(SourceError, match="is not a pad model"):
        simulated(tmp_path)
    write_pad_file(tmp_path / "pad.npz", influence().mechanics(), Slab())
    with pytest.raises(SourceError, match="was made for a magnet of 2 × 2 mm, not of 3 × 2 mm"):
        simulated(tmp_path, "diameter_mm = 3.0\n")


def test_presses_of_another_slab_are_not_taken_for_this_ones(tmp_path: Path) -> None:
    path, press = tmp_path / "presses.csv", [Press(4e-3, 1e-3, 0.2)]
    solve_into(path, press, Slab(), ELEMENT_M, lambda share: None)
    whole = path.read_bytes()
    path.write_bytes(whole[:-9])  # ended amid its last line
    solve_into(path, press, Slab(), ELEMENT_M, lambda share: None)
    assert path.read_bytes() == whole
    for slab, element_m in ((Slab(c10_pa=0.1e6), ELEMENT_M), (Slab(), 1e-3)):
        with pytest.raises(ValueError, match="another slab or element size"):
            solve_into(path, press, slab, element_m, lambda share: None)
    path.with_suffix(".json").unlink()
    with pytest.raises(ValueError, match="is not there to tell its slab"):
        solve_into(path, press, Slab(), ELEMENT_M, lambda share: None)
    assert path.read_bytes() == whole


def test_mesh_that_no_memory_holds_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fine = ["pad-model", "--config", "config.toml", "-o", str(tmp_path / "p.npz"), "--element-mm", "0.2"]
    assert main(fine) == DATA
    assert "memory than a computer has" in capsys.readouterr().err


def test_solved_press_is_bit_identical_in_any_order() -> None:
    press, fresh, used = Press(4e-3, 0.0, 0.6), *(PressedSlab(Slab(), COARSE_M) for _ in range(2))
    used.solve(Press(8e-3, 4e-3, 0.8))
    used.rest()
    for one, other in zip(fresh.solve(press), used.solve(press), strict=True):
        np.testing.assert_array_equal(one, other)


def test_two_processes_solve_and_resume_the_same_file(tmp_path: Path) -> None:
    presses = [Press(x * 1e-3, 0.0, force_n) for x in (0, 4, 8) for force_n in (0.3, 0.6)]
    files = [tmp_path / name for name in ("one.csv", "two.csv", "interrupted.csv")]
    shares: list[float] = []
    solve_into(files[0], presses, Slab(), COARSE_M, shares.append)
    solve_into(files[1], presses, Slab(), COARSE_M, shares.append, Workers(2))
    assert files[0].read_bytes() == files[1].read_bytes()
    solve_into(files[2], presses[4:], Slab(), COARSE_M, lambda share: None)  # another place was solved first
    solve_into(files[2], presses, Slab(), COARSE_M, shares.append, Workers(2))
    assert files[2].read_bytes() == files[0].read_bytes()
    assert shares[-1] == 1.0
