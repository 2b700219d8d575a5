"""Whose bundles a machine takes: those of whoever signed the first signed one, and nobody else's."""

import subprocess
from pathlib import Path

from tools import bundle
from tools.rehearsal.bundles import resummed, variant
from tools.rehearsal.life import WATCH_S, Life


def signed(life: Life) -> None:
    """Who made a bundle is who may, from the first signed one on."""
    good, changed = life.bundles / "0.3.0", life.bundles / "0.4.0"
    variant(life.built, good, "0.3.0")
    bundle.sign(good, _key(life.bundles, "key"))
    variant(life.built, life.bundles / "0.5.0", "0.5.0")
    bundle.sign(life.bundles / "0.5.0", _key(life.bundles, "stranger"))
    resummed(good, changed, "README.md", "changed by somebody, sums and all\n")
    words = f"base --watch {WATCH_S:g}"
    done = life.install("0.3.0", words)
    fine = done.returncode == 0 and "from now on only bundles signed" in done.stdout
    life.note("a signed bundle is taken, and its signers are kept", fine, done.stdout[-300:] + done.stderr)
    for version, kind, told in (
        ("0.4.0", "a changed", "signature is nobody's"),
        ("0.5.0", "a stranger's", "signature is nobody's"),
        ("0.6.0", "an unsigned", "the bundle is not signed"),
    ):
        done = life.install(version, words)
        fine = done.returncode == 1 and told in done.stderr and life.state() == "0.3.0 active active"
        life.note(f"{kind} bundle is refused", fine, done.stderr)
    done = life.install("0.3.0", words)
    fine = done.returncode == 0 and "signed by one of" in done.stdout
    life.note("a bundle of the right signer is taken again", fine, done.stdout[-300:] + done.stderr)


def _key(folder: Path, name: str) -> Path:
    words = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", str(folder / name)]
    subprocess.run(words, check=True, stdin=subprocess.DEVNULL)
    return folder / name
