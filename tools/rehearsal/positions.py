"""Wait for MAVLink positions on this network: `python -m tools.rehearsal.positions PORT COUNT SECONDS`.

An independent receiver (tools/doubles/listener.py); run on a machine's network, it says how many came and when.
"""

import json
import sys
import time

from tools.doubles.listener import Listener


def main() -> int:
    """0 if enough came in time."""
    port, count, within_s = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    began_s = time.monotonic()
    with Listener(port) as listener:
        print("listening", flush=True)
        first_s = time.monotonic() - began_s if listener.wait(1, within_s) else None
        enough = listener.wait(count, max(0.0, within_s - (time.monotonic() - began_s)))
        print(json.dumps({"first_s": first_s, "positions": len(listener.positions)}), flush=True)
    return 0 if enough else 1


if __name__ == "__main__":
    sys.exit(main())
