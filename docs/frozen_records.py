"""The site shows the records of the package as dataclasses, which `granular_lmp.frozen` makes."""

from typing import Any

from griffe import Alias, Extension


class FrozenRecords(Extension):
    """Read the decorator of `granular_lmp.frozen` as that of the standard library."""

    def on_alias_instance(self, *, alias: Alias, **_: Any) -> None:
        """Lead its name to `dataclasses.dataclass`."""
        if alias.target_path == "granular_lmp.frozen.dataclass":
            alias.target_path = "dataclasses.dataclass"
