"""MCAP files written by other tools: with messages that are not from ROS, an unset profile, or without an index."""

from __future__ import annotations

from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import Writer

LIBRARY = "bdnn_ros"
ROS = ("ros2msg", "ros2idl", "omgidl", "")
"""Encodings of schemas that a ROS 2 bag may have."""


def of_ros(path: Path, directory: Path, types: tuple[str, ...]) -> Path:
    """A copy of a file with its ROS messages; messages of types other than these are copied without content.

    Thus every topic appears with its number of messages, and images take no space.

    Raises:
        McapError: the file is damaged.
    """
    place = directory / path.name
    with path.open("rb") as source, place.open("wb") as target:
        writer, schemas, channels = Writer(target), dict[int, int](), dict[int, int]()
        writer.start("ros2", LIBRARY)
        for schema, channel, message in make_reader(source).iter_messages(log_time_order=False):
            if schema is None or schema.encoding not in ROS:
                continue
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            data = message.data if schema.name in types else b""
            writer.add_message(
                channels[channel.id], message.log_time, data, message.publish_time, message.sequence
            )
        writer.finish()
    return place
