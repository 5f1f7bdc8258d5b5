"""Declared document (a scene or a collision): a name and sections of keys, read from TOML and written back."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import field
from pathlib import Path
from typing import Any, ClassVar, Self

from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.scene.files import file_text, toml_tables
from granular_lmp.scene.records import DeclaredKey, Variant, declared_keys, plain, record, toml_lines, without_defaults
from granular_lmp.scene.schema import (
    Rule,
    Rules,
    checked_description,
    checked_name,
    cut,
    default_name,
    head_lines,
    plain_value,
    refuse_unknown,
    shown,
    unknown_key,
)


@dataclass(frozen=True)
class Layout:
    """Tables and keys of a kind of document.

    Attributes
    ----------
    sections : mapping of str to type
        TOML table → the type of its record, in the order of the file.
    rules : mapping
        TOML table → rules, for records that carry none.
    attributes : mapping
        TOML table → attribute that holds its record, if the attribute has another name.
    repeated : mapping of str to type
        Array of tables → the type of its records. Only values that differ from a default are written.
    optional : tuple of str
        Sections that are written only if they differ from their defaults.
    none_if_left_out : tuple of str
        Sections whose record is None if the document does not have them.
    exclusive : mapping
        Dotted key → keys that it replaces: a document never holds both, and `with_values` of the key removes them.
    variants : mapping of str to Variant
        Kinds of the document by name; a kind may change defaults of keys, or refuse keys.
    """

    sections: Mapping[str, type]
    rules: Mapping[str, Rules] = field(default_factory=dict)
    attributes: Mapping[str, str] = field(default_factory=dict)
    repeated: Mapping[str, type] = field(default_factory=dict)
    optional: tuple[str, ...] = ()
    none_if_left_out: tuple[str, ...] = ()
    exclusive: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    variants: Mapping[str, Variant] = field(default_factory=lambda: {"": Variant()})

    @property
    def tables(self) -> dict[str, type]:
        """Tables and arrays of tables → the type of a record."""
        return {**self.sections, **self.repeated}

    def keys_of(self, table: str, variant: str) -> Sequence[DeclaredKey]:
        """Return the keys of a table in a kind of document, with their defaults."""
        return declared_keys(self.tables[table], self.rules.get(table), table, self.variants[variant])

    def differing(self, table: str) -> set[str]:
        """Return the names of the keys of a table whose default depends on the kind of the document."""
        dotted = (key.partition(".") for variant in self.variants.values() for key in variant.defaults)
        return {name for section, _, name in dotted if section == table}


@dataclass(frozen=True)
class Document:
    """A name, a description and sections, each a record whose fields carry their rules.

    Attributes
    ----------
    name : str
    description : str
        One line for a list of documents, without effect on a run.
    layout : Layout
    """

    name: str
    description: str = field(default="", kw_only=True)
    layout: ClassVar[Layout]

    @classmethod
    def read(cls, file: Path, changes: Mapping[str, Any] | None = None) -> Self:
        """Return the document in a TOML file; `changes` apply before any value is checked (`changed`).

        Errors of an unchanged file begin with its path.
        """
        text = file_text(file)
        try:
            tables = cls._located(toml_tables(text), file.parent)
            if not changes:
                return cls.from_dict(tables, default_name(file))
        except SceneError as error:
            raise SceneError(f"{file}: {error}", because=error.because) from error
        return cls.from_dict(cls.changed(tables, changes), default_name(file))

    @classmethod
    def loads(cls, text: str) -> Self:
        """Return the document in TOML text; files that it names are relative to the current folder."""
        return cls.from_dict(toml_tables(text))

    @classmethod
    def _located(cls, tables: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Return the tables with names of files relative to the current folder; they are given relative to `folder`."""
        return tables

    @classmethod
    def from_dict(cls, tables: Mapping[str, Any], default: str | None = None) -> Self:
        """Return the document that nested mappings declare (see `to_dict`); every key and value is checked."""
        tables, layout = plain_value(tables), cls.layout
        refuse_unknown(tables, ("name", "description", *layout.sections, *layout.repeated), "")
        name = checked_name(tables, default or cls.__name__.lower(), "the files of the run")
        tables = cls._completed(tables)
        variant = cls._variant_of(tables)
        records: dict[str, Any] = {
            layout.attributes.get(key, key): record(kind, tables.get(key), key, layout.keys_of(key, variant))
            for key, kind in layout.sections.items()
            if key in tables or key not in (*layout.none_if_left_out, *layout.variants[variant].refused)
        }
        records |= {key: cls._records(key, tables.get(key, ()), variant) for key in layout.repeated}
        return cls._of_fields({"name": name, "description": checked_description(tables)} | cls._solved(records))

    @classmethod
    def _of_fields(cls, values: Mapping[str, Any]) -> Self:
        """Return the document with these fields."""
        return cls(**values)

    @classmethod
    def _variant_of(cls, tables: Mapping[str, Any]) -> str:
        """Return the name of the kind of document that the tables declare."""
        return ""

    @property
    def _variant(self) -> str:
        """Name of the kind of this document."""
        return ""

    @classmethod
    def _records(cls, key: str, tables: Any, variant: str) -> tuple[Any, ...]:
        """Return the records of an array of tables; errors count them from 1."""
        if not isinstance(tables, list | tuple):
            raise SceneError(f"{key} = {shown(tables)}: must be tables, each under a line [[{key}]]")
        kind, keys = cls.layout.repeated[key], cls.layout.keys_of(key, variant)
        return tuple(record(kind, table, f"{key}.{number}", keys) for number, table in enumerate(tables, start=1))

    @classmethod
    def _completed(cls, tables: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the tables in which alternative keys are translated into the keys of the sections."""
        return tables

    @classmethod
    def _solved(cls, records: dict[str, Any]) -> dict[str, Any]:
        """Return the records with the values that follow from several of them."""
        return records

    def to_dict(self) -> dict[str, Any]:
        """Return nested plain values with every default."""
        records = {key: getattr(self, self.layout.attributes.get(key, key)) for key in self.layout.sections}
        tables: dict[str, Any] = {
            key: plain(value, self.keys_of(key))
            for key, value in records.items()
            if value is not None
            and key not in self.layout.variants[self._variant].refused
            and (key not in self.layout.optional or value != type(value)())
        }
        tables |= {key: self._written(key) for key in self.layout.repeated if getattr(self, key)}
        return {"name": self.name, "description": self.description} | tables

    def _written(self, key: str) -> list[dict[str, Any]]:
        """Return the values of an array of tables that differ from their defaults."""
        keys = self.keys_of(key)
        default = plain(self.layout.repeated[key](), keys)
        tables = (plain(each, keys) for each in getattr(self, key))
        return [{name: value for name, value in table.items() if value != default[name]} for table in tables]

    def keys_of(self, table: str) -> Sequence[DeclaredKey]:
        """Return the keys of a table, with their defaults in this document."""
        return self.layout.keys_of(table, self._variant)

    def given(self) -> dict[str, Any]:
        """Return nested plain values without defaults, which never change: what a file must contain."""
        tables = self.to_dict()
        for key in self.layout.sections:
            defaults, table = {each.name: each.default for each in self.keys_of(key)}, tables.pop(key, {})
            given = ((name, value) for name, value in table.items() if value is not defaults[name])
            differing = {name: value for name, value in given if repr(value) != repr(defaults[name])}
            tables |= {key: differing} if differing else {}
        return tables

    def to_toml(self, *, full: bool = False) -> str:
        """Return TOML text that `loads` reads back to an equal document, with a comment behind each value.

        With `full` the text includes the defaults.
        """
        return self._text(self.to_dict()) if full else self._toml

    @cached_property
    def _toml(self) -> str:
        return self._text(self.given())

    def _text(self, tables: Mapping[str, Any]) -> str:
        lines, layout = head_lines(self.name, self.description), self.layout
        for key in layout.sections:
            if key in tables:
                lines += ["", f"[{key}]", *toml_lines(tables[key], self.keys_of(key))]
        for key in layout.repeated:
            for table in tables.get(key, ()):
                lines += ["", f"[[{key}]]", *toml_lines(table, self.keys_of(key))]
        return "\n".join(lines) + "\n"

    def with_values(self, changes: Mapping[str, Any]) -> Self:
        """Return a copy with some values changed, named by dotted keys: ``{"sphere.radius": 1e-6}``.

        Raises
        ------
        SceneError
            If a key is unknown or a value is not allowed.
        """
        return self.from_dict(self.changed(self.given(), changes))

    @classmethod
    def changed(cls, tables: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return tables, checked or not, with the values of dotted keys replaced."""
        cls._refuse_part(tables, changes)
        for key, value in changes.items():
            table, _, name = key.rpartition(".")
            inner = cls._table(tables, key, table)
            if not isinstance(inner, dict):
                break  # a value, or an earlier change, stands in place of the table: report this as the error
            for other in cls.layout.exclusive.get(key, ()):
                if other not in changes:
                    inner.pop(other.rpartition(".")[2], None)
            inner[name] = deepcopy(value)  # a later key may change a part of the copy
        return tables

    @classmethod
    def _refuse_part(cls, tables: Mapping[str, Any], changes: Mapping[str, Any]) -> None:
        """Raise SceneError if changes set only some keys of a table that the document does not have."""

    def replace(self, **tables: Any) -> Self:
        """Return a copy with tables replaced by a record or a sequence of records: ``scene.replace(striker=())``.

        ``None`` or an empty sequence leaves a table out. `with_values` changes single values.

        Raises
        ------
        SceneError
            If there is no such table, or a value is not allowed.
        """
        kept = {key: value for key, value in self.given().items() if key not in tables}
        return self.from_dict(kept | self._plain_tables(tables))

    @classmethod
    def _plain_tables(cls, tables: Mapping[str, Any]) -> dict[str, Any]:
        """Return tables of records as nested plain values, without empty ones."""
        plain_tables = {key: without_defaults(table, cls.layout.differing(key)) for key, table in tables.items()}
        return {key: table for key, table in plain_tables.items() if table not in (None, {}, [])}

    def value(self, key: str) -> Any:
        """Return the value of a dotted key, as `with_values` takes it; None if no field of the scene holds the key."""
        table, _, name = key.rpartition(".")
        section, _, number = table.partition(".")
        record = getattr(self, self.layout.attributes.get(section, section), None)
        found = getattr(record[int(number) - 1] if number and record else record, name, None)
        return _lists(found)

    @classmethod
    def _table(cls, tables: dict[str, Any], key: str, table: str) -> Any:
        """Return the table of a dotted key: a section, or "inclusion.1" for the first table of an array."""
        name, _, number = table.partition(".")
        if name in cls.layout.repeated and number:
            there = tables.get(name, [])
            if not isinstance(there, list):
                return there
            if not number.isdecimal() or not 1 <= int(number) <= len(there):
                raise SceneError(f"{cut(key)}: the scene has {len(there)} [[{name}]], counted from 1")
            return there[int(number) - 1]
        if table and table not in cls.layout.sections:
            raise SceneError(unknown_key(key, table, cls.layout.sections))
        return tables.setdefault(table, {}) if table else tables


def _lists(value: Any) -> Any:
    """Return a value with its tuples as lists, as files and commands give them."""
    return [_lists(each) for each in value] if isinstance(value, tuple) else value


def note(key: str, document: Document | type[Document]) -> str:
    """Return the comment behind a dotted key in a document, mostly its unit."""
    return rule_of(key, document).note


def rule_of(key: str, document: Document | type[Document]) -> Rule:
    """Return the rule of a dotted key in a document; KeyError if there is none."""
    if key == "wave.wavevector":
        return Rule(float, "rad per lattice constant", "[kx, ky], in place of wavenumber and direction")
    table, *_, name = key.split(".")  # "source.1.frequency" belongs to the first [[source]]
    keys = declared_keys(document.layout.tables[table], document.layout.rules.get(table))
    return {each.name: each.rule for each in keys}[name]
