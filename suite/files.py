"""Files that are whole or not there: written under another name, flushed and renamed."""

import os
import re
from collections.abc import Iterable
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, replacing what was there in one moment. Raises OSError when the disk does not take it."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as sink:
            sink.write(content)
            sink.flush()
            os.fsync(sink.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def sweep(candidates: Iterable[Path], names: str) -> None:
    """Remove what writers that are no longer alive left half written of files whose names match a pattern.

    Raises OSError when one cannot be removed.
    """
    for path in candidates:
        match = re.fullmatch(rf"\.({names})\.(\d+)\.tmp", path.name)
        if match and not _alive(int(match[match.re.groups])):
            path.unlink(missing_ok=True)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
