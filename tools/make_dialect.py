"""Generate calib/station/outputs/mavlink/dialect.py, the private MAVLink dialect, from deploy/mavlink/skyfix.xml.

Run after every change of the XML: `python -m tools.make_dialect`. Any change of a released message needs a new id.
"""

import contextlib
import io
import re
import tempfile
from pathlib import Path

from pymavlink.generator import mavgen, mavparse

ROOT = Path(__file__).resolve().parent.parent
XML = ROOT / "deploy" / "mavlink" / "skyfix.xml"
DIALECT = ROOT / "calib" / "station" / "outputs" / "mavlink" / "dialect.py"


def generate(xml: str) -> str:
    """Python source of the dialect's own messages; the standard ones go on coming from pymavlink."""
    with tempfile.TemporaryDirectory() as folder:
        own, made = Path(folder, "skyfix.xml"), Path(folder, "dialect.py")
        own.write_text(re.sub(r"\s*<include>.*?</include>", "", xml))
        options = mavgen.Opts(str(made), wire_protocol=mavparse.PROTOCOL_2_0, language="Python3", validate=False)
        with contextlib.redirect_stdout(io.StringIO()):
            mavgen.mavgen(options, [str(own)])
        return made.read_text()


def main() -> None:
    """Write the dialect module."""
    DIALECT.write_text(generate(XML.read_text()))
    print(f"{DIALECT.relative_to(ROOT)} written")


if __name__ == "__main__":
    main()
