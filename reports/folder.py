"""The folder of a site: which of its files a former build left there, and which of them are still right."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from suite.errors import BadInput
from suite.files import sweep, write_whole

MANIFEST = "_filterbench_site.json"
_OURS = r"[a-z0-9-]+\.html|data/[a-z0-9-]+\.(?:csv|tex|json|js)|static/[a-z]+\.(?:css|js)"
Files = Mapping[str, str]
"""Contents by name."""


class Folder:
    """A folder for a site. Raises BadInput when it is a file, holds other things, or cannot be written.

    Files come in parts, each with a key that stands for all that it was made from. The manifest names the parts from the
    moment on when their first file may be there, so that a build that is interrupted can be taken up, or cleaned away.
    """

    def __init__(self, out: Path):
        self.out = out
        self.former = self._read()
        self.parts: dict[str, dict[str, Any]] = {}

    def holds(self, part: str, key: str) -> bool:
        """Whether a former build left this part made from the same, whole and unchanged; it is then kept."""
        said = self.former.get(part)
        if said is None or said["key"] != key:
            return False
        try:
            same = all(_digest((self.out / name).read_bytes()) == digest for name, digest in said["files"].items())
        except OSError:
            return False
        if same:
            self.parts[part] = said
        return same

    def write(self, part: str, key: str, files: Files) -> None:
        """Write the files of a part."""
        encoded = {name: text.encode("utf-8", "replace") for name, text in files.items()}
        with self._writing():
            for name in encoded:
                (self.out / name).parent.mkdir(parents=True, exist_ok=True)
            self.parts[part] = {"key": "", "files": dict.fromkeys(encoded, "")}
            self._note()
            for name, content in encoded.items():
                write_whole(self.out / name, content)
            self.parts[part] = {"key": key, "files": {name: _digest(content) for name, content in encoded.items()}}
            self._note()

    def text(self, name: str) -> str:
        """A file of the site."""
        with self._writing():
            return (self.out / name).read_text(encoding="utf-8")

    def finish(self) -> None:
        """Remove what former builds left that is no longer due."""
        due = set(_names(self.parts))
        with self._writing():
            for name in set(_names(self.former)) - due:
                (self.out / name).unlink(missing_ok=True)
            for folder in (self.out, self.out / "data", self.out / "static"):
                if folder.is_dir():
                    places = (folder / path.name for path in folder.iterdir())
                    sweep(places, r"[a-z0-9-]+\.(?:html|csv|tex|json|js|css)")
                    if folder != self.out and not any(folder.iterdir()):
                        folder.rmdir()
            self.former = {}
            self._note()

    def _read(self) -> dict[str, dict[str, Any]]:
        with self._writing():
            if self.out.exists() and not self.out.is_dir():
                raise BadInput(f"--out {self.out} is a file; name a folder")
            if not self.out.is_dir() or not any(self.out.iterdir()):
                return {}
            manifest = self.out / MANIFEST
            if not manifest.is_file():
                raise BadInput(f"--out {self.out} holds other files and no filterbench site; name an empty or new folder")
            return _parts_in(manifest.read_text(encoding="utf-8", errors="replace"))

    def _note(self) -> None:
        self.out.mkdir(parents=True, exist_ok=True)
        said = {"site": "filterbench", "parts": self.former | self.parts}
        write_whole(self.out / MANIFEST, (json.dumps(said, indent=1) + "\n").encode())

    def _writing(self) -> "_Writing":
        return _Writing(self.out)


class _Writing:
    """Turns the errors of the disk into one line that names the folder."""

    def __init__(self, out: Path):
        self.out = out

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, OSError):
            reason = error.strerror or error
            words = f"cannot write the site to {self.out}: {reason}; make it writable or name another folder"
            raise BadInput(words) from error


def _names(parts: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    for part in parts.values():
        yield from part["files"]


def _parts_in(manifest: str) -> dict[str, dict[str, Any]]:
    """The parts in a manifest as far as their files can be ours; none when it is damaged."""
    try:
        found = json.loads(manifest)["parts"]
        return {
            str(name): {
                "key": str(said["key"]),
                "files": {f: str(digest) for f, digest in said["files"].items() if re.fullmatch(_OURS, f)},
            }
            for name, said in found.items()
        }
    except (ValueError, KeyError, TypeError, AttributeError):
        return {}


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:24]
