"""What a scene needs, on six scenes made for it. That a pad told of its neighbour beats one that is not, through the
whole pipeline, is in test_neighbours.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmfts.config import (
    I2cSource,
    MagnetConfig,
    PadConfig,
    PlacementConfig,
    SceneConfig,
    SimulatedSource,
    ToleranceConfig,
)
from fmfts.config.file import load
from fmfts.contact import ContactModel
from fmfts.contact.response import Response
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.dataset import standard_pad
from fmfts_calibrate.samples import Samples
from fmfts_calibrate.tracked import FrameSolver
from fmfts_lab.calibration.simulated import rest_field_of
from fmfts_lab.scene import (
    LOAD_SHARES,
    PLACES_MM,
    Cost,
    Model,
    Surroundings,
    configured,
    costs,
    placed_beside,
    recommended,
)
from fmfts_lab.study.harness import Request
from fmfts_lab.study.scene_facts import largest_field_gauss, limits, recommended_range_gauss, would_pay
from fmfts_lab.study.scene_networks import Networks
from fmfts_lab.study.scene_study import SHIPPED, printed, run
from fmfts_lab.study.scene_trial import tried, tried_beside

BENCH_TOP = SceneConfig(ambient="constant")
# Three times larger at half the distance, of weak ferrite: neodymium would saturate the widest range tenfold.
LARGE = MagnetConfig(diameter_mm=6.0, length_mm=6.0, remanence_t=0.1, rest_mm=(0, 0, 6))


def pad(name: str = "one", **changes: object) -> PadConfig:
    return PadConfig(name=name, **({"source": SimulatedSource()} | changes))  # type: ignore[arg-type]


def beside(distance_mm: float) -> PadConfig:
    return pad("two", placement=PlacementConfig(position_mm=(distance_mm, 0.0, 0.0)))


def told_of(other: str, distance_mm: float = 0.0) -> PadConfig:
    return pad(
        "two" if other == "one" else "one",
        source=SimulatedSource(range_gauss=4.0),
        tolerance=ToleranceConfig(gain=0.005, sensor_rotation_deg=0.0, cross_axis=0.0),
        scene=SceneConfig(neighbours=(other,)),
        placement=PlacementConfig(position_mm=(distance_mm, 0.0, 0.0), rotation_deg=(8.0, 0.0, 0.0)),
    )


@pytest.fixture(scope="module")
def response() -> Response:
    held = ContactModel.load("default", standard_pad()).response
    assert held is not None
    return held


def up_to(response: Response, force_n: float) -> Response:
    """The same pad, calibrated with no more than `force_n`."""
    share = (force_n / response.scale_n) ** response.exponent.sum(axis=1)
    return replace(response, scale_n=force_n, coefficient=response.coefficient * share[:, None])


def best(config: PadConfig, response: Response, *others: PadConfig) -> Cost:
    return recommended(costs(Surroundings(config, response, others=others)))


def test_bench_top_pad_needs_six_unknowns_and_turning_arm_eight(response: Response) -> None:
    assert best(pad(scene=BENCH_TOP), response).model == Model(6, True)
    assert best(pad(), response).model == SHIPPED
    assert best(pad(scene=SceneConfig(ambient="constant", steel_nearby=True)), response).model == SHIPPED


@pytest.mark.parametrize("scene", [BENCH_TOP, SceneConfig()])
def test_larger_magnet_at_half_the_distance_needs_cylinder_term(response: Response, scene: SceneConfig) -> None:
    found = best(pad(magnet=LARGE, scene=scene), response)
    assert found.model.cylinder
    assert pad(magnet=LARGE).pad().magnet.as_cylinder  # so the daemon uses the cylinder, too


def test_octupole_is_recommended_only_where_it_matters(response: Response) -> None:
    weak = pad(magnet=MagnetConfig(remanence_t=0.3))
    for config, felt in ((pad(), True), (weak, False)):
        assert best(config, response).model == Model(8, felt)
        assert config.pad().magnet.as_cylinder is felt  # so does the daemon


def test_neighbour_is_chosen_20_mm_away_and_not_200(response: Response) -> None:
    assert best(pad(), response, beside(20.0)).model == Model(8, True, ("two",))
    assert best(pad(), response, beside(200.0)).model == SHIPPED


def test_third_of_a_newton_needs_a_smaller_network(response: Response) -> None:
    """Of so light a press a frame tells less, so that a network errs by more than it before it is too small."""

    def bias(force_n: float) -> float:
        networks = Networks.of(Surroundings(pad(), up_to(response, force_n)), quick=True)
        (row,) = networks.rows(6)
        return float(row["bias_in_bounds"])  # type: ignore[arg-type]

    assert bias(0.3) < 0.5 * bias(response.scale_n)


def test_bus_too_slow_for_220_hz_is_reported_with_what_it_carries(response: Response) -> None:
    slow = pad(source=I2cSource(bus=1, clock_hz=100_000, rate_hz=150))
    rate = limits(Surroundings(slow, response))[1]
    assert "150 Hz, at most 168" in rate  # 4·143 + 20 bits at 100 kHz
    assert "not 220" in rate
    fast = pad(source=I2cSource(bus=1, clock_hz=400_000, rate_hz=220))
    assert limits(Surroundings(fast, response))[1] == "rate: 220 Hz of 220"


def test_range_fits_the_hardest_press_or_names_a_magnet_that_would(response: Response) -> None:
    standard = Surroundings(pad(), response)
    assert 2.5 < largest_field_gauss(standard) < 2.55  # 2.02 G of the magnet under 1.98 N, and 0.5 G of the Earth
    # ±2.5 G is the range that the data sheet recommends for 660 counts a gauss; 2047 of them are 3.10 G.
    assert recommended_range_gauss(standard) == SimulatedSource().range_gauss == 2.5
    (said, _) = limits(standard)
    assert said == "largest field on an axis: 2.52 G; set to ±2.5 G, chips saturate at 3.10 G"
    assert recommended_range_gauss(Surroundings(pad(magnet=LARGE), response)) == 8.1
    near, far = (Surroundings(pad(), response, others=[beside(away_mm)]) for away_mm in (20.0, 200.0))
    # A magnet 20 mm away is 19 mm from two of the sensors: 3.3 G in all.
    assert (recommended_range_gauss(near), recommended_range_gauss(far)) == (4.0, 2.5)
    strong = MagnetConfig(diameter_mm=6.0, length_mm=6.0, remanence_t=1.23, rest_mm=(0, 0, 6))
    assert "no range holds it" in limits(Surroundings(pad(magnet=strong), response))[0]


def test_first_order_noise_is_the_bound_that_the_solver_gives(response: Response) -> None:
    """By another way: the compiled kernel's covariance, carried through the response."""
    config, press = pad(), np.array([[x, y, s] for x in PLACES_MM for y in PLACES_MM for s in LOAD_SHARES])
    solver = FrameSolver(config.pad(), rest_field_of(config.pad()), "drifting", NOISE_T)
    bound = Samples.expected(response, solver, press * [1.0, 1.0, response.scale_n]).bound
    (cost,) = (cost for cost in costs(Surroundings(config, response)) if cost.model == SHIPPED)
    assert [cost.noise_mm, cost.noise_n] == pytest.approx(rms(bound).tolist(), rel=0.005)


def test_six_unknowns_beat_the_default_on_a_bench_top(response: Response) -> None:
    surroundings = Surroundings(pad(scene=BENCH_TOP), response)
    mine, default = (rms(tried(surroundings, model, 400, 1)) for model in (Model(6, True), SHIPPED))
    # To first order 0.44 of its place and 0.50 of its force: the default's bias. Presses of four seeds have 0.40 to
    # 0.60 and 0.64 to 0.76.
    assert (mine < 0.85 * default).all()


def test_cylinder_term_beats_the_dipole_for_a_larger_magnet(response: Response) -> None:
    surroundings = Surroundings(pad(magnet=LARGE, scene=BENCH_TOP), response)
    mine, dipole, default = (
        rms(tried(surroundings, model, 400, 1)) for model in (Model(6, True), Model(6, False), SHIPPED)
    )
    assert (mine < 0.8 * dipole).all()
    assert (mine < 0.1 * default).all()


@pytest.mark.long
def test_named_neighbour_gives_more_answers_and_none_wrong(response: Response) -> None:
    near = Surroundings(told_of("two"), response, others=[told_of("one", distance_mm=20.0)])
    told, untold = tried_beside(near, 6.0, 1)
    assert told.outcome.wrong == untold.outcome.wrong == 0
    assert told.answered > 0.99
    # `disturbed` while the other pad's finger moves its magnet, and for a while after. With hidden_gradient.py left
    # out 0.83 are answered, but in `bench neighbours` 163 frames are then wrong.
    assert 0.1 < untold.answered < 0.5


@pytest.mark.parametrize("name", ["bench-top", "large-magnet", "neighbour"])
def test_scenes_of_the_docs_need_other_settings_than_the_default(response: Response, name: str) -> None:
    (config, _) = load(Path(f"docs/scenes/{name}.toml"))
    first, *others = config.pad
    surroundings = Surroundings(first, response, others=placed_beside(first, others))
    assert recommended(costs(surroundings, thorough=False)).model == configured(surroundings) != SHIPPED


def test_larger_model_pays_where_the_docs_say_so(response: Response) -> None:
    """The factor that is printed, put into the scene, is where the recommendation turns."""
    weak = pad(scene=BENCH_TOP, magnet=MagnetConfig(remanence_t=0.3))
    surroundings = Surroundings(weak, response)
    (line,) = (line for line in would_pay(surroundings, recommended(costs(surroundings))) if "times as strong" in line)
    factor = float(line.partition("magnet ")[2].partition(" ")[0])
    for share, cylinder in ((0.9, False), (1.1, True)):
        stronger = Surroundings(weak, response, noise_t=surroundings.noise_t / (factor * share))
        assert recommended(costs(stronger)).model.cylinder is cylinder


def test_only_pads_whose_place_is_known_are_beside() -> None:
    here, unplaced, near, far = (
        pad(),
        pad("three"),
        beside(20.0),
        pad("far", placement=PlacementConfig(position_mm=(90, 0, 0))),
    )
    assert placed_beside(here, [here, far, unplaced, near]) == [near, far]


def test_quick_study_says_and_draws_what_decided(tmp_path: Path) -> None:
    facts = run(Request(pad(scene=BENCH_TOP), tmp_path, quick=True))
    said = printed(facts)
    assert "recommended: 6 unknowns, cylinder; the config has 6 unknowns, cylinder" in said
    assert "would pay with an ambient field that changes by" in said
    assert {path.name for path in tmp_path.iterdir()} == {f"scene.{kind}" for kind in ("csv", "json", "png", "svg")}


def rms(errors: np.ndarray) -> np.ndarray:
    """The rms errors of place and of force."""
    return np.sqrt([np.mean(errors[:, :2] ** 2), np.mean(errors[:, 2] ** 2)])
