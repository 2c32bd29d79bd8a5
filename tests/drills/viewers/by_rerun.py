"""Prints the ROS 2 messages of a recording as Rerun's own reader decodes them, as lines of JSON."""

from __future__ import annotations

import json
import sys

from rerun.chunk import McapReader  # type: ignore[import-not-found]

TRANSFORM = "Transform3D:"


def main() -> None:
    for chunk in McapReader(sys.argv[1]).stream():
        batch = chunk.to_record_batch()
        topic = str(chunk.entity_path)
        for column in batch.schema.names:
            if column.endswith(":message") and topic.startswith("/ros/"):
                for row in batch.column(column).to_pylist():
                    print(json.dumps({"topic": topic, "told": row[0]}))
        if topic == "/tf" and f"{TRANSFORM}translation" in batch.schema.names:  # drawn, and no longer a ROS message
            parts = {name: batch.column(TRANSFORM + name).to_pylist() for name in ("parent_frame", "child_frame")}
            for row, place in enumerate(batch.column(f"{TRANSFORM}translation").to_pylist()):
                told = {
                    "header": {"frame_id": parts["parent_frame"][row][0]},
                    "child_frame_id": parts["child_frame"][row][0],
                    "transform": {"translation": dict(zip("xyz", place[0], strict=True))},
                }
                print(json.dumps({"topic": topic, "told": told}))


if __name__ == "__main__":
    main()
