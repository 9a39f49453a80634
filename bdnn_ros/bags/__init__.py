"""Bags and recordings: MCAP, rosbag2 directories and sqlite3 files in, MCAP and rosbag2 directories out."""

from bdnn_ros.bags.commands import commands_among
from bdnn_ros.bags.copies import copies_kept
from bdnn_ros.bags.description import read_description
from bdnn_ros.bags.every import EveryState, read_every
from bdnn_ros.bags.left_over import left_over
from bdnn_ros.bags.playing import Played, read_to_play
from bdnn_ros.bags.positions import read_positions
from bdnn_ros.bags.reading import Progress, read, topics
from bdnn_ros.bags.selection import Selection
from bdnn_ros.bags.storage import Topic
from bdnn_ros.bags.writing import refuse_existing, write

__all__ = [
    "EveryState",
    "Played",
    "Progress",
    "Selection",
    "Topic",
    "commands_among",
    "copies_kept",
    "left_over",
    "read",
    "read_description",
    "read_every",
    "read_positions",
    "read_to_play",
    "refuse_existing",
    "topics",
    "write",
]
