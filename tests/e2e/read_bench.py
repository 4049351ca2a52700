"""Reads the samples of a bench run with the format's own package, and checks every one against its channel's schema.

Nothing of the project takes part. It prints what it found, as JSON, and fails at the first thing that is not as it must be.
"""

import json
import sys

from jsonschema import Draft202012Validator
from mcap.reader import make_reader

samples, validator, last = 0, None, -1
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    records = {record.name: record.metadata for record in reader.iter_metadata()}
    motor = json.loads(next(reader.iter_attachments()).data)
    summary = reader.get_summary()
    for schema, channel, message in reader.iter_messages():
        if validator is None:
            shape = json.loads(schema.data)
            Draft202012Validator.check_schema(shape)
            assert set(shape["required"]) == set(shape["properties"])
            validator = Draft202012Validator(shape)
        sample = json.loads(message.data)
        validator.validate(sample)
        assert message.log_time > last
        assert sample["position"] == sample["l"] - sample["r"]
        last, samples = message.log_time, samples + 1

assert summary.statistics.message_count == samples
print(
    json.dumps(
        {
            "samples": samples,
            "channel": [channel.topic, schema.name, schema.encoding, channel.message_encoding],
            "about": records["supersigma.bench"],
            "outcome": records["supersigma.bench.outcome"],
            "load_inertia": motor["load_inertia"],
            "last": sample,
        }
    )
)
