"""The name `analysis` for modules of `granular_analysis`: one module under two names, not two copies."""

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import InspectLoader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec, spec_from_loader
from types import CodeType, ModuleType


class ShortName(MetaPathFinder, InspectLoader):
    """Finder of `analysis.X`, which is the module `granular_analysis.X`, also for ``python -m analysis.X``."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if not fullname.startswith("analysis."):
            return None
        found = find_spec(f"granular_{fullname}")
        if found is None:
            return None
        parts = found.submodule_search_locations
        return spec_from_loader(fullname, self, origin=found.origin, is_package=parts is not None)

    def exec_module(self, module: ModuleType) -> None:
        sys.modules[module.__name__] = import_module(f"granular_{module.__name__}")

    def get_code(self, fullname: str) -> CodeType | None:
        found = find_spec(f"granular_{fullname}")
        if found is None or not isinstance(found.loader, InspectLoader):
            raise ImportError(f"No module named {fullname!r}", name=fullname)
        return found.loader.get_code(f"granular_{fullname}")

    def get_source(self, fullname: str) -> str | None:
        """Return None: the source is that of the module's own name."""
        return None
