"""ROS 1 bags, made from their definition."""

import bz2
import struct

import lz4.frame

PACKET, ARRAY = "event_camera_msgs/EventPacket", "dvs_msgs/EventArray"


def sized(data):
    return struct.pack("<I", len(data)) + data


def record(op, data=b"", **fields):
    fields = {"op": bytes([op])} | fields
    return sized(b"".join(sized(name.encode() + b"=" + value) for name, value in fields.items())) + sized(data)


def connection(kind, number=0, topic=b"/events"):
    data = sized(b"topic=" + topic) + sized(b"type=" + kind.encode())
    return record(7, data, conn=struct.pack("<I", number), topic=topic)


def message(data, number=0):
    return record(2, data, conn=struct.pack("<I", number), time=bytes(8))


def bag(*records, packed="none"):
    """A bag of one chunk."""
    inner = b"".join(records)
    data = {"none": bytes, "bz2": bz2.compress, "lz4": lz4.frame.compress}[packed](inner)
    size = struct.pack("<I", len(inner))
    return b"#ROSBAG V2.0\n" + record(3, b" " * 99) + record(5, data, compression=packed.encode(), size=size)


def packet(payload, encoding="mono", base=0, size=(640, 480), big=False):
    head = bytes(12) + sized(b"cam") + struct.pack("<II", *reversed(size)) + struct.pack("<QQ", 7, base)
    return head + sized(encoding.encode()) + bytes([big]) + sized(payload)


def mono(rows, base):
    return b"".join(struct.pack("<Q", p << 63 | y << 48 | x << 32 | 1000 * t + 7 - base) for t, x, y, p in rows)


def array(rows, size=(640, 480)):
    events = b"".join(struct.pack("<HHIIB", x, y, *divmod(t * 1000 + 999, 10**9), p) for t, x, y, p in rows)
    return bytes(12) + sized(b"") + struct.pack("<II", *reversed(size)) + struct.pack("<I", len(rows)) + events
