"""What a shot file says under `view`: how its light is shown."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from pydantic import ValidationInfo, model_validator

from pipeline.shot.documents.fields import Document
from pipeline.shot.yaml.parse_context import Surroundings, finding
from render.base.errors import BadInputError
from render.post.view import ACES, BUILT_IN, ColourView, view_of

_TABLE = re.compile(r"\bsrc\s*:\s*([^,}\n]+)")
"""How a config names the tables that it rests on."""


class ViewDocument(Document):
    """A view of an OpenColorIO config; what is not said is the config's default."""

    config: str = ACES.config
    view: str | None = None
    display: str | None = None
    space: str | None = None

    _found: ColourView = ACES

    @model_validator(mode="after")
    def _is_there(self, info: ValidationInfo) -> ViewDocument:
        if not self.model_fields_set:  # our own; asking OpenColorIO for it would take time
            return self
        try:
            config, digest = self._of_file(Surroundings.of(info))
            self._found = view_of(config, self.view, self.display, self.space, digest)
        except BadInputError as error:
            raise finding(str(error)) from None
        return self

    def build(self) -> ColourView:
        return self._found

    def _of_file(self, surroundings: Surroundings) -> tuple[str, str]:
        """Where the config lies, and a digest of all that its colours rest on."""
        if self.config.startswith(BUILT_IN):
            return self.config, ""
        path = surroundings.file(self.config)
        files = [path, *_tables(path)]
        for table in files[1:]:
            surroundings.file(str(table.relative_to(surroundings.folder)))
        digests = [surroundings.digests[file] for file in files]
        return str(path), hashlib.sha256("".join(digests).encode()).hexdigest()


def _tables(config: Path) -> list[Path]:
    """The files beside a config, or below, that have a name which it mentions."""
    if config.suffix != ".ocio":
        return []
    text = config.read_text(encoding="utf-8", errors="replace")
    names = {Path(name.strip().strip("'\"")).name for name in _TABLE.findall(text)}
    return sorted(found for name in names if name for found in config.parent.rglob(name) if found.is_file())
