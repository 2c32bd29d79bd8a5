// Prints the ROS 2 messages of a recording as Foxglove's own parsers read them, as lines of JSON.
import { open } from "node:fs/promises";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers } from "@mcap/support";

// JSON has no NaN, but Python reads it.
function text(value) {
  if (typeof value === "number") return Number.isNaN(value) ? "NaN" : String(value);
  if (typeof value === "string" || typeof value === "boolean") return JSON.stringify(value);
  if (ArrayBuffer.isView(value) || Array.isArray(value)) return `[${[...value].map(text).join(",")}]`;
  return `{${Object.entries(value).map(([name, part]) => `${JSON.stringify(name)}:${text(part)}`).join(",")}}`;
}

const file = await open(process.argv[2], "r");
const reader = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(file),
  decompressHandlers: await loadDecompressHandlers(),
});
const readers = new Map();
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId);
  if (schema.encoding !== "ros2msg") continue;
  if (!readers.has(channel.id)) {
    readers.set(channel.id, new MessageReader(parse(new TextDecoder().decode(schema.data), { ros2: true })));
  }
  console.log(text({ topic: channel.topic, told: readers.get(channel.id).readMessage(message.data) }));
}
await file.close();
