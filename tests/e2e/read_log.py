"""Reads a whole log with the format's own package, and checks every message against its channel's schema.

Nothing of the project takes part. It prints what it found, as JSON, and fails at the first thing that is not as it must be.
"""

import json
import math
import sys
from collections import Counter, deque

from jsonschema import Draft202012Validator
from mcap.reader import make_reader

SAMPLE_TICKS = 20_000  # log.sample_ms = 10, in ticks of 0.5 µs
RADIANS_PER_STEP = math.tau / 400  # the built-in set has no motors: the bench motor's turn

topics, schemas, validators = Counter(), {}, {}
statuses, grid, stood, events = {}, Counter(), set(), []
last_log_time, joints = 0, None


def point(tick):
    """The point of the grid that a tick is, or is next to; log times are rounded."""
    nearest = round(tick / SAMPLE_TICKS)
    return nearest if abs(tick - nearest * SAMPLE_TICKS) <= 1 else None


def close(one, other):
    return one == other or (None not in (one, other) and math.isclose(one, other, abs_tol=1e-9))


with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    about = next(record.metadata for record in reader.iter_metadata() if record.name == "supersigma")
    epoch, scale = int(about["epoch_ns"]), float(about["time_scale"])
    names = [about[f"axis.{number}"] for number in range(1, 8)]
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        assert message.log_time >= last_log_time, f"log times fall on {channel.topic}"
        last_log_time = message.log_time
        topics[channel.topic] += 1
        schemas[channel.topic] = [schema.name, schema.encoding, channel.message_encoding]
        if channel.topic == "/microbus":
            continue
        value = json.loads(message.data)
        if schema.id not in validators:
            shape = json.loads(schema.data)
            Draft202012Validator.check_schema(shape)
            validators[schema.id] = Draft202012Validator(shape), set(shape["properties"])
        validator, properties = validators[schema.id]
        validator.validate(value)
        assert set(value) <= properties, f"{set(value) - properties} of {channel.topic} is in no schema"
        if "tick" in value:
            # The real clock, however fast the machine's runs.
            assert abs(message.publish_time - epoch - value["tick"] * 500 / scale) <= 1, value
        if channel.topic.startswith("/axis/"):
            statuses.setdefault(value["name"], deque(maxlen=3)).append(value)
            if value["activity"] == "standing":
                stood.add(point(value["acted_at"]))
        if "timestamp" in value:
            stamp = value["timestamp"]["sec"] * 10**9 + value["timestamp"]["nsec"]
            assert stamp == (message.publish_time if channel.topic == "/joint_states" else message.log_time) or (
                channel.topic == "/events" and stamp == message.publish_time
            ), value
        if channel.topic == "/events":
            events.append([value["level"], value["name"], value["message"]])
        if channel.topic == "/joint_states":
            joints = value["joints"]
            assert [joint["name"] for joint in joints] == names
            for joint in joints:
                # As one of the latest statuses of that axis has it: frames of several axes cross on the bus.
                assert any(
                    close(joint["velocity"], status["speed"] * RADIANS_PER_STEP)
                    and close(
                        joint.get("position"),
                        status["position"] * RADIANS_PER_STEP if "position" in status else None,
                    )
                    for status in statuses[joint["name"]]
                ), (joint, list(statuses[joint["name"]]))
            grid[point(round((message.publish_time - epoch) * scale / 500))] += 1

grid.pop(None, None)
# Where axes come to a stand, each is told of, wherever that falls.
assert grid and all(grid[at] == 1 for at in grid.keys() - stood), "a point of the grid has two messages"
for joint in joints:
    last = statuses[joint["name"]][-1]
    assert close(joint.get("position"), last["position"] * RADIANS_PER_STEP if "position" in last else None)
    assert joint["velocity"] == 0
json.dump({"topics": topics, "schemas": schemas, "events": events, "grid": len(grid)}, sys.stdout)
