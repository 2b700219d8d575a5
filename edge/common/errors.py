"""What can go wrong, as one small tree.

    SkyfixError
    ├── ConfigError        a configuration, site or lens file is wrong: exit code 2
    ├── MessageError       bytes from the network or a recording are not what they claim to be
    ├── LensError          a lens model cannot do what was asked of it
    ├── SourceError        a camera, stream or video does not open, or is dead
    │   └── LoginError     a camera refuses who logs in: not to be tried again and again
    ├── ModelError         a detection model does not load, or has a shape we cannot decode
    ├── GnssError          a receiver cannot be reached or contradicts itself
    ├── LinkError          the network session cannot be opened
    ├── RecordingError     a recording cannot be written or read
    └── CalibrationError   the observations do not determine what was asked for (calib/errors.py)

Silent failure is what users of such systems complain of most, and an error that only says "failed" is next. So an
error always carries three sentences: what is wrong, where, and what to do next.
"""


class SkyfixError(Exception):
    """An error a user can act on.

    what: the fault, in plain words. where: the file, key, device or camera it concerns. action: what to do next.
    """

    def __init__(self, what: str, *, where: str, action: str) -> None:
        super().__init__(what, where, action)
        self.what = what
        self.where = where
        self.action = action

    def __str__(self) -> str:
        return f"{self.where}: {self.what}; {self.action}"

    def __reduce__(self) -> tuple[object, tuple[type["SkyfixError"], str, str, str]]:
        # Keyword-only arguments do not pickle by themselves, and the solver's errors cross a process border.
        return (_rebuild, (type(self), self.what, self.where, self.action))


def _rebuild(kind: type[SkyfixError], what: str, where: str, action: str) -> SkyfixError:
    return kind(what, where=where, action=action)


class ConfigError(SkyfixError):
    """A configuration, site or lens file is wrong."""


class MessageError(SkyfixError):
    """Bytes from the network or a recording are not what they claim to be."""


class LensError(SkyfixError):
    """A lens model cannot do what was asked of it."""


class SourceError(SkyfixError):
    """A camera, stream or video does not open, or is dead."""


class LoginError(SourceError):
    """A camera refuses the user name or password: trying again at once locks accounts."""


class ModelError(SkyfixError):
    """A detection model does not load, or has a shape that cannot be decoded."""


class GnssError(SkyfixError):
    """A receiver cannot be reached or contradicts itself."""


class LinkError(SkyfixError):
    """The network session cannot be opened."""


class RecordingError(SkyfixError):
    """A recording cannot be written or read."""
