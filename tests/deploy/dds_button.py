# SPDX-License-Identifier: Apache-2.0
"""An emergency stop on DDS, for the tests: it latches its state, or repeats it."""

from __future__ import annotations

import sys
import time

from cyclonedds.core import Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic

from pm01_nav.deploy import dds_types as types
from pm01_nav.deploy.dds import dds_config, reliable, transient_local


def main() -> None:
    domain, latched = int(sys.argv[1]), sys.argv[2] == "True"
    owner = Domain(domain, dds_config("127.0.0.1", ()))
    participant = DomainParticipant(domain)
    promises = (reliable(), transient_local()) if latched else (reliable(),)
    topic = Topic(participant, "rt/emergency_stop", types.Bool)
    writer = DataWriter(participant, topic, qos=Qos(*promises))
    writer.write(types.Bool(data=True))
    sys.stdout.write("pressed\n")
    sys.stdout.flush()
    for _ in range(600):
        time.sleep(0.1)
        if not latched:
            writer.write(types.Bool(data=True))
    del owner


main()
