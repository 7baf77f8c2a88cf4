"""The TCP sockets on which a process listens, from Linux's /proc."""

import os
from pathlib import Path

LISTENING = "0A"
LOCAL = {"0100007F", "00000000000000000000000001000000", "0000000000000000FFFF00000100007F"}
"""127.0.0.1 and ::1, as Linux writes them."""


def listening_addresses(pid="self"):
    """Returns the addresses (hexadecimal, as Linux writes them) on which a process listens."""
    held = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        try:
            held.add(os.readlink(entry))
        except OSError:  # The descriptor of this very listing.
            continue
    addresses = []
    for table in ("tcp", "tcp6"):
        path = Path(f"/proc/{pid}/net/{table}")
        for line in path.read_text().splitlines()[1:] if path.exists() else ():
            fields = line.split()
            if fields[3] == LISTENING and f"socket:[{fields[9]}]" in held:
                addresses.append(fields[1].split(":")[0])
    return addresses
