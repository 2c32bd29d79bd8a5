"""What Foxglove and PlotJuggler find in a recording: schemas that they can read, and drawings that the SDK accepts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import foxglove.messages
import msgspec
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from json_schemas import fits
from mcap.reader import make_reader

from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig, PlacementConfig, SimulatedSource
from fmfts.pad import rotation_from_vector
from fmfts_recording.file import KINDS, RecordingError, RecordingWriter, is_whole, read
from fmfts_recording.foxglove import Quaternion, rotation_of, turning
from fmfts_recording.plain_schema import plain_schema, with_nulls, without_nulls
from fmfts_recording.repair import repair
from fmfts_recording.scene import SHOWN_HZ, PadScene

CONFIG = PadConfig(
    name="left",
    source=SimulatedSource(),
    placement=PlacementConfig(position_mm=(10, -20, 30), rotation_deg=(0, 90, 0)),
)
POSE = {
    "position_m": [1e-4, -2e-4, 0.0118], "position_sd_m": [1e-5, 1e-5, 2e-5], "axis": [0.0, 0.6, 0.8],
    "axis_sd_rad": 1e-3, "remanence_t": 1.2, "remanence_sd_t": 0.01, "ambient_t": None, "ambient_sd_t": None,
    "residual_t": 1e-7, "chi2": 3.0,
}  # fmt: skip
LAYOUTS = Path(__file__).parents[2] / "extras/foxglove/layouts"


@pytest.mark.parametrize("name", ["foxglove.json", "plotjuggler.xml"])
def test_layout_names_pads_so_that_sed_can_replace_them(name: str) -> None:
    """As docs/foxglove.md says: `s|/left|/thumb|g`."""
    text = (LAYOUTS / name).read_text().replace("/left", "/thumb")
    assert "contact/thumb" in text
    assert "left" not in text.replace('left="0"', "")


def contact(index: int, **changed: Any) -> dict[str, Any]:
    fields = {
        "v": 1, "pad": "left", "boot": "b", "seq": index, "t_sample_ns": index, "t_publish_ns": index,
        "utc_ns": 1_800_000_000_000_000_000 + round(index * 1e9 / 220), "temperature_c": None, "health": "ok",
        "reason": "", "contact": True, "x_m": 2e-3, "x_sd_m": 1e-4, "y_m": -1e-3, "y_sd_m": 2e-4, "force_n": 1.5,
        "force_sd_n": 0.02, "shear_x_n": None, "shear_x_sd_n": None, "shear_y_n": None, "shear_y_sd_n": None,
        "over_range": False, "force_min_n": None, "displacement_m": None, "displacement_sd_m": None, "pose": POSE,
        "now": None, "sensors_ok": 15, "model": "m", "baseline": None,
    }  # fmt: skip
    return fields | changed


FINGER = {
    "id": 3, "x_m": -4e-3, "x_sd_m": 1e-4, "y_m": 2e-3, "y_sd_m": 1e-4, "force_n": 0.6, "force_sd_n": 0.02,
    "shear_x_n": None, "shear_x_sd_n": None, "shear_y_n": None, "shear_y_sd_n": None,
}  # fmt: skip
SEVERAL = contact(300, pose=None, poses=[POSE, POSE], contacts=[FINGER, FINGER | {"id": 4}], more=False)


def drawn(*contacts: dict[str, Any]) -> list[Any]:
    scene = PadScene.of_state("left", msgspec.to_builtins(CONFIG))
    return [each for one in contacts for each in scene.contact(one)]


def entities(*contacts: dict[str, Any]) -> dict[str, Any]:
    """The entities that are there after these contacts, by id."""
    there: dict[str, Any] = {}
    for each in drawn(*contacts):
        if each.schema == "foxglove.SceneUpdate":
            for deletion in each.message.deletions:
                there.pop(deletion.id, None)
            there |= {entity.id: entity for entity in each.message.entities}
    return there


def sdk_type(name: str) -> Any:
    """The message of Foxglove's SDK with this name, of its own descriptors."""
    files = descriptor_pb2.FileDescriptorSet.FromString(
        getattr(foxglove.messages, name.partition(".")[2]).get_schema().data
    )
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


def as_protobuf(value: Any) -> Any:
    """JSON of Foxglove, as protobuf's JSON writes it: times and durations are texts there."""
    if isinstance(value, dict) and value.keys() == {"sec", "nsec"}:
        seconds = np.datetime64(value["sec"], "s")
        return f"{seconds}.{value['nsec']:09d}Z" if value["sec"] else f"{value['sec']}.{value['nsec']:09d}s"
    if isinstance(value, dict):
        return {name: as_protobuf(each) for name, each in value.items()}
    return [as_protobuf(each) for each in value] if isinstance(value, (list, tuple)) else value


def test_sdk_knows_every_field_of_the_drawings() -> None:
    seen = set()
    for each in drawn(
        contact(0), contact(100, health="degraded", reason="sensor 3"), contact(200, contact=False), SEVERAL
    ):
        if each.schema.startswith("foxglove."):
            kind, body = sdk_type(each.schema), msgspec.to_builtins(each.message)
            parsed = json_format.ParseDict(
                as_protobuf(body), kind()
            )  # raises for a field or a type that is not its own
            assert {field.name for field in kind.DESCRIPTOR.fields} == body.keys(), "and none of its fields is missing"
            assert parsed.ByteSize() > 0
            seen.add(each.schema)
    assert seen == {
        "foxglove.SceneUpdate",
        "foxglove.PoseInFrame",
        "foxglove.PosesInFrame",
        "foxglove.FrameTransform",
    }


def test_every_part_of_an_entity_has_all_fields_of_the_sdks() -> None:
    def compare(body: Any, descriptor: Any) -> None:
        if descriptor.full_name.startswith("google.protobuf."):
            return
        assert {field.name for field in descriptor.fields} == body.keys(), descriptor.full_name
        for field in descriptor.fields:
            if field.message_type is not None:
                found = body[field.name]
                for each in found if isinstance(found, (list, tuple)) else [found]:
                    compare(each, field.message_type)

    for each in drawn(contact(0, health="degraded", reason="sensor 3"), SEVERAL):
        if each.schema.startswith("foxglove."):
            compare(msgspec.to_builtins(each.message), sdk_type(each.schema).DESCRIPTOR)


def assert_plain(schema: dict[str, Any], path: str) -> None:
    """The form that Foxglove's reader of JSON schemas takes; anything else makes it refuse the channel."""
    assert schema["type"] == "object", path
    for name, each in schema["properties"].items():
        where = f"{path}.{name}"
        assert isinstance(each["type"], str), where
        assert each["type"] in ("boolean", "string", "number", "integer", "object", "array"), where
        item = each["items"] if each["type"] == "array" else each
        assert item["type"] != "array", where
        assert "$ref" not in item, where
        if item["type"] == "object":
            assert_plain(item, where)


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path)
    scene = PadScene.of_state("left", msgspec.to_builtins(CONFIG))
    for index in range(220):
        body = contact(index, contact=index % 50 > 20)
        writer.add("contact", "left", body)
        for each in scene.contact(body):
            writer.draw(each, body["utc_ns"])
        if index % 55 == 54:
            writer.flush()
    writer.finish()
    writer.close()
    return path


def test_every_channel_has_a_plain_schema_that_its_messages_fit(recorded: Path) -> None:
    counts: dict[str, int] = {}
    schemas: dict[str, Any] = {}
    with recorded.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert channel.message_encoding == "json"
            if channel.topic not in counts:
                described = msgspec.json.decode(schema.data)
                assert_plain(described, schema.name)
                schemas[channel.topic] = described
            assert fits(msgspec.json.decode(message.data), schemas[channel.topic])
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    assert counts.keys() == {"contact/left", "scene/left", "magnet/left", "transform/left", "wrench/left"}
    assert counts["contact/left"] == 220
    assert counts["magnet/left"] <= SHOWN_HZ + 1


@pytest.mark.parametrize("kind", KINDS)
def test_schema_of_every_message_is_plain(kind: str) -> None:
    assert_plain(plain_schema(KINDS[kind]), kind)


def test_nulls_are_left_out_and_come_back() -> None:
    body = contact(0)
    kept = without_nulls(body, ContactMessage)
    assert "temperature_c" not in kept
    assert "ambient_t" not in kept["pose"]
    assert with_nulls(kept, ContactMessage) == body
    assert with_nulls(body, ContactMessage) == body, "recordings of before have their nulls"
    free = {"config": {"path": None}}
    assert without_nulls(free, KINDS["state"]) == free, "what is in a free map stays"


def test_replay_sees_no_drawings(recorded: Path) -> None:
    found = [one.message for one in read(recorded)]
    assert found == [msgspec.convert(contact(i, contact=i % 50 > 20), ContactMessage) for i in range(220)]


def test_repair_gives_a_killed_recording_its_index(recorded: Path, tmp_path: Path) -> None:
    with recorded.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recorded.read_bytes()[: summary.chunk_indexes[2].chunk_start_offset + 100])
    before = [one.message for one in read(cut)]
    assert len(before) == 110, "two chunks of 55 are whole"
    facts = repair(cut, tmp_path / "mended.mcap")
    assert is_whole(tmp_path / "mended.mcap")
    assert [one.message for one in read(tmp_path / "mended.mcap")] == before
    with (tmp_path / "mended.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == facts["messages"] > len(before), "the drawings are there, too"
    with pytest.raises(RecordingError, match="is whole"):
        repair(tmp_path / "mended.mcap", tmp_path / "again.mcap")
    with pytest.raises(RecordingError, match="never overwritten"):
        repair(cut, tmp_path / "mended.mcap")


def test_drawn_contact_follows_the_finger() -> None:
    there = entities(contact(0))
    touch = there["contact"]
    (ellipse,) = touch.cylinders
    assert (ellipse.pose.position.x, ellipse.pose.position.y, ellipse.pose.position.z) == (2e-3, -1e-3, 0.012)
    # 95 % of a normal distribution in two dimensions: √5.991 deviations to each side.
    assert ellipse.size.x == pytest.approx(2 * math.sqrt(5.991) * 1e-4, rel=1e-3)
    (arrow,) = touch.arrows
    assert arrow.pose.position.z > 0.012, "it comes from above"
    assert arrow.shaft_length + arrow.head_length == pytest.approx(arrow.pose.position.z - 0.012)
    assert "contact" not in entities(contact(0), contact(100, contact=False))
    assert "magnet" not in entities(contact(0), contact(100, pose=None, health="lost"))
    assert there.keys() == {"pad", "magnet", "contact"}


def test_over_range_pad_shows_no_force_and_says_so() -> None:
    there = entities(contact(0, over_range=True))
    assert there["contact"].arrows == ()
    assert "harder" in there["health"].texts[0].text
    assert not [each for each in drawn(contact(0, over_range=True)) if each.topic.startswith("wrench/")]


def matrix(turn: Quaternion) -> np.ndarray:
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.mark.parametrize("end", [(0, 0.6, 0.8), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0.3, -0.2, -5)])
@pytest.mark.parametrize("start", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)])
def test_arrows_and_magnets_point_along_their_direction(start: tuple[float, ...], end: tuple[float, ...]) -> None:
    turned = matrix(turning(start, end)) @ np.array(start)
    np.testing.assert_allclose(turned, np.array(end) / np.linalg.norm(end), atol=1e-12)


def test_placement_turns_as_its_matrix() -> None:
    for vector in np.random.default_rng(1).normal(scale=2.0, size=(200, 3)):
        rotation = rotation_from_vector(vector)
        np.testing.assert_allclose(matrix(rotation_of(rotation.tolist())), rotation, atol=1e-12)
