"""The study of what transfers to other pads: methods on one pad of another solver, the summary and the chart."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts_lab.study import transfer
from fmfts_lab.study.harness import Row
from fmfts_lab.study.transfer import FIELD, METHODS, PADS, Kind, OfPad, medians, printed
from fmfts_lab.study.transfer_chart import draw


@pytest.fixture(scope="module")
def soft() -> OfPad:
    return OfPad.of(Kind(1.38, 0.5, 4.0), seed=1, seconds=6.0)


def off(pair: tuple[np.ndarray, np.ndarray]) -> float:
    true, found = pair
    return float(np.median(np.abs(found[:, 2] / true[:, 2] - 1.0)))


def test_weight_takes_the_model_to_softer_silicone(soft: OfPad) -> None:
    assert off(soft.told(soft.bench.config)) > 0.5, "silicone of half the modulus reads twice the force"
    assert off(soft.told(soft.bench.config, weighed=True)) < 0.08


def test_five_presses_take_the_model_to_softer_silicone(soft: OfPad) -> None:
    assert off(soft.five_presses()) < 0.08


def test_network_from_field_knows_its_own_pad_only(soft: OfPad, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transfer, "FIELD_PRESSES", 300)
    own = OfPad.of(PADS[0], seed=1, seconds=6.0)
    assert off(own.from_field()) < 0.35
    assert off(soft.from_field()) > 0.5


def rows() -> list[Row]:
    return [
        {
            "pad": kind.name,
            **kind._asdict(),
            "method": method,
            "force_off": 0.02 * (1 + number),
            "force_off_90": 0.1,
            "place_mm": 0.4,
            "frames": 100,
        }
        for kind in PADS
        for number, method in enumerate(METHODS)
    ]


def test_summary_has_each_method_once() -> None:
    found = medians(rows())
    assert list(found) == list(METHODS)
    assert found[FIELD]["force_off"] == 0.02
    assert all(method in printed({"medians": found}) for method in METHODS)


def test_chart_names_each_line_beside_it() -> None:
    figure = draw(rows(), METHODS)
    axes = figure.axes[0]
    assert [text.get_text() for text in axes.texts] == list(METHODS)
    assert axes.get_legend() is None
    assert len(axes.lines) == len(METHODS)
    heights = [text.xy[1] for text in axes.texts]  # type: ignore[attr-defined]
    assert (np.diff(heights) > 0.0).all(), "no name covers another one"
