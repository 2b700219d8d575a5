"""What a role needs of a bundle is found, and what is lacking is named before anything is laid."""

import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from deploy.installer.telling import RefusedError
from deploy.installer.wheelhouse import needed

HERE = f"{sys.version_info.major}{sys.version_info.minor}"


def wheel(folder: Path, name: str, *requires: str, tag: str = "py3-none-any", payload: bytes = b"") -> None:
    metadata = [f"Metadata-Version: 2.1\nName: {name}\nVersion: 1", *(f"Requires-Dist: {line}" for line in requires)]
    with zipfile.ZipFile(folder / f"{name}-1-{tag}.whl", "w") as file:
        file.writestr(f"{name}-1.dist-info/METADATA", "\n".join(metadata) + "\n")
        file.writestr(f"{name}/data", payload)


@pytest.fixture
def wheels(tmp_path: Path) -> Path:
    """A small bundle, with a pip that is this environment's, as a wheel."""
    wheel(
        tmp_path,
        "skyfix",
        "common",
        'solver; extra == "base"',
        'eye[fast]; extra == "box"',
        'old; python_version < "3"',
    )
    wheel(tmp_path, "common", payload=b"x" * 1000)
    wheel(tmp_path, "solver", "common")
    wheel(tmp_path, "eye", 'quick; extra == "fast"', tag=f"cp{HERE}-abi3-{sysconfig.get_platform().replace('-', '_')}")
    wheel(tmp_path, "quick")
    return tmp_path


def found(wheels: Path, *extras: str) -> list[str]:
    return [each.path.name.split("-")[0] for each in needed(wheels, extras)]


@pytest.fixture(autouse=True)
def _pip_in_the_bundle(wheels: Path) -> None:
    import pip  # noqa: PLC0415 -- only to find it

    vendored = Path(pip.__file__).parent
    with zipfile.ZipFile(wheels / "pip-1-py3-none-any.whl", "w") as file:
        file.writestr("pip/__init__.py", "")
        for source in (vendored / "_vendor").rglob("*.py"):
            file.write(source, f"pip/{source.relative_to(vendored)}")


def test_each_role_gets_what_it_needs(wheels: Path) -> None:
    assert found(wheels) == ["common", "skyfix"]
    assert found(wheels, "base") == ["common", "skyfix", "solver"]
    assert found(wheels, "box") == ["common", "eye", "quick", "skyfix"]
    assert found(wheels, "box", "base") == ["common", "eye", "quick", "skyfix", "solver"]


def test_a_wheel_for_another_python_is_told_with_both(wheels: Path) -> None:
    next(wheels.glob("eye-*")).rename(wheels / "eye-1-cp39-cp39-manylinux_2_17_riscv64.whl")
    with pytest.raises(RefusedError, match=r"no eye for Python 3\.\d+ on .*, only for cp39-.*tools\.bundle --python"):
        found(wheels, "box")


def test_a_wheel_that_is_missing_is_named(wheels: Path) -> None:
    next(wheels.glob("quick-*")).unlink()
    with pytest.raises(RefusedError, match=r"no quick for .*make bundle"):
        found(wheels, "box")


def test_a_bundle_without_pip_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "empty"
    folder.mkdir()
    with pytest.raises(RefusedError, match="no pip"):
        found(folder)


def test_it_is_found_by_the_installer_alone(wheels: Path) -> None:
    """Without anything of this environment: the machine has a bare Python."""
    code = (
        "import sys; from pathlib import Path; from installer.wheelhouse import needed; "
        "print(len(needed(Path(sys.argv[1]), ['base'])))"
    )
    deploy = Path(__file__).parents[2] / "deploy"
    done = subprocess.run(
        [sys._base_executable, "-S", "-c", code, str(wheels)],
        env={"PYTHONPATH": str(deploy)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout.strip(), done.stderr) == ("3", "")
