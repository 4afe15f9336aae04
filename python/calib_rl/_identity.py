"""Digests of values that are the same in every process. They identify stored results.

A `repr` is not enough: for a function or an object it has an address. The source of a function lacks the values that it refers to.
"""

from __future__ import annotations

import copyreg
import dis
import functools
import hashlib
import importlib.util
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, GetSetDescriptorType, MappingProxyType, MemberDescriptorType, MethodType, ModuleType
from typing import Any

import numpy as np

# Attributes of a class that do not affect its behaviour, or that Python makes again in each process.
_SKIPPED = {
    "__abstractmethods__", "__annotate__", "__annotate_func__", "__annotations__", "__annotations_cache__", "__dict__", "__doc__", "__firstlineno__",
    "__module__", "__orig_bases__", "__parameters__", "__static_attributes__", "__type_params__", "__weakref__", "_abc_impl",
}  # fmt: skip
_PLAIN = (type(None), bool, int, float, complex, str, type(...), type(NotImplemented))


class Unstable(Exception):
    """A value without a description that is the same in every process. The text names the value."""


def identity(value: Any, name: str) -> str:
    """Returns a digest of a value and of everything that it refers to.

    Functions count by their code, defaults, closures, and the globals that they read. Classes count by their attributes, and other objects
    by their pickled state. Code of installed packages and of Python itself counts by its name and version.

    Args:
        value: The value.
        name: The name of the value in an error.

    Raises:
        Unstable: It refers to something that cannot be described, such as a lock or an open file.
    """
    try:
        text = json.dumps(_Describer(name).described(value))
    except RecursionError:
        raise Unstable(f"{name} is nested too deeply") from None
    return hashlib.sha256(text.encode()).hexdigest()


class _Describer:
    """Turns values into nested lists of texts."""

    def __init__(self, name: str) -> None:
        self._path = [name]
        # Functions, classes and objects described before. They are kept so that no other object gets their address.
        self._seen: dict[int, tuple[int, object]] = {}
        # Containers and modules that are being described, which may contain themselves.
        self._open: list[int] = []

    def described(self, value: Any) -> list[Any]:
        kind = type(value)
        if kind in _PLAIN:
            return [kind.__name__, repr(value)]
        if kind in (bytes, bytearray):
            return [kind.__name__, _digest(value)]
        if kind in (list, tuple, set, frozenset, dict, MappingProxyType):
            return self._once(value, lambda: self._container(value))
        if kind is np.ndarray and not value.dtype.hasobject:
            return ["array", str(value.dtype), list(value.shape), _digest(value.tobytes())]
        if "torch" in sys.modules and isinstance(value, sys.modules["torch"].Tensor):
            return self._tensor(value)
        if isinstance(value, ModuleType):
            return self._module(value, set())
        if id(value) in self._seen:
            return ["again", self._seen[id(value)][0]]
        self._seen[id(value)] = (len(self._seen), value)
        if isinstance(value, CodeType):
            return self._code(value)
        if isinstance(value, FunctionType):
            return self._function(value)
        if isinstance(value, type):
            return self._class(value)
        return self._bound(value) or self._object(value)

    def _tensor(self, value: Any) -> list[Any]:
        # `pickle` stores a tensor differently in each process.
        try:
            data = value.detach().cpu().contiguous().view(-1).view(sys.modules["torch"].uint8).numpy().tobytes()
        except Exception as error:
            raise self._unstable(value) from error
        return [type(value).__name__, str(value.dtype), list(value.shape), _digest(data)]

    def _unstable(self, value: Any) -> Unstable:
        first, *rest = self._path
        path = first + "".join(name if name.startswith("[") else f".{name}" for name in rest)
        return Unstable(f"{path} is a {type(value).__module__}.{type(value).__qualname__}")

    @contextmanager
    def _within(self, name: str) -> Iterator[None]:
        self._path.append(name)
        yield
        # An exception skips this line, so that its message has the whole path.
        self._path.pop()

    def _once(self, value: Any, describe: Callable[[], list[Any]]) -> list[Any]:
        if id(value) in self._open:
            return ["within", self._open.index(id(value))]
        self._open.append(id(value))
        text = describe()
        self._open.pop()
        return text

    def _container(self, value: Any) -> list[Any]:
        kind = type(value).__name__
        if isinstance(value, Mapping):
            pairs = []
            for key, item in value.items():
                with self._within(f"[{key!r}]" if isinstance(key, (str, int)) else "[...]"):
                    pairs.append([self.described(key), self.described(item)])
            return [kind, sorted(pairs, key=json.dumps)]
        items = [self.described(item) for item in value]
        return [kind, sorted(items, key=json.dumps) if isinstance(value, (set, frozenset)) else items]

    def _code(self, code: CodeType) -> list[Any]:
        # Names of files and line numbers are left out, so that a moved function keeps its identity.
        counts = [code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags]
        names = [code.co_name, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars]
        table = getattr(code, "co_exceptiontable", b"")
        return ["code", _digest(code.co_code), _digest(table), counts, names, [self.described(constant) for constant in code.co_consts]]

    def _function(self, function: FunctionType) -> list[Any]:
        # `functools.wraps` gives a function the module of another one. Its globals belong to the module where it was written.
        module = function.__globals__.get("__name__")
        is_own = _is_own(module)
        if not is_own and _is_reachable(module, function.__qualname__, function):
            return ["function", module, _version(module), function.__qualname__]
        code = function.__code__
        names = set(_names(code))
        cells = []
        for name, cell in zip(code.co_freevars, function.__closure__ or ()):
            try:
                content = cell.cell_contents
            except ValueError:  # a variable that is not set yet
                continue
            with self._within(name):
                cells.append([name, self._referred(content, names)])
        with self._within("defaults"):
            defaults = self.described([function.__defaults__, function.__kwdefaults__, vars(function)])
        read = self._globals(function, names) if is_own else [_version(module)]
        return ["function", self._code(code), defaults, cells, read]

    def _globals(self, function: FunctionType, names: set[str]) -> list[Any]:
        found = []
        loaded, imported = _reads(function.__code__)
        for name in sorted(loaded & function.__globals__.keys()):
            with self._within(name):
                found.append([name, self._referred(function.__globals__[name], names)])
        package = function.__globals__.get("__package__") or ""
        return [found, [_imported(name, package) for name in sorted(imported)]]

    def _referred(self, value: Any, names: set[str]) -> list[Any]:
        return self._module(value, names) if isinstance(value, ModuleType) else self.described(value)

    def _module(self, module: ModuleType, names: set[str]) -> list[Any]:
        """Describes a module of the user's program by its file and the values in ``names``, and any other module by its version."""
        name = module.__name__
        if not _is_own(name):
            return ["module", name, _version(name)]

        def describe() -> list[Any]:
            values = []
            for attribute in sorted(names & vars(module).keys()):
                with self._within(attribute):
                    values.append([attribute, self._referred(vars(module)[attribute], names)])
            return ["module", name, _digest_of_file(getattr(module, "__file__", None)), values]

        return self._once(module, describe)

    def _class(self, value: type) -> list[Any]:
        module = value.__module__
        if not _is_own(module) and _is_reachable(module, value.__qualname__, value):
            return ["class", module, _version(module), value.__qualname__]
        attributes = []
        for name, attribute in sorted(vars(value).items()):
            if name not in _SKIPPED:
                with self._within(name):
                    attributes.append([name, self.described(attribute)])
        bases = [self.described(base) for base in value.__bases__]
        return ["class", value.__qualname__, self.described(type(value)), bases, attributes]

    def _bound(self, value: Any) -> list[Any] | None:
        """Describes values that stand for functions: methods, properties, and compiled functions."""
        if isinstance(value, MethodType):
            return ["method", self.described(value.__func__), self.described(value.__self__)]
        if isinstance(value, (staticmethod, classmethod)):
            return [type(value).__name__, self.described(value.__func__)]
        if isinstance(value, property):
            return ["property", *map(self.described, (value.fget, value.fset, value.fdel))]
        if isinstance(value, functools.cached_property):
            return ["property", self.described(value.func)]
        if isinstance(value, BuiltinFunctionType):
            owner = value.__self__
            is_free = owner is None or isinstance(owner, ModuleType)
            return ["builtin", value.__module__, value.__qualname__, [] if is_free else self.described(owner)]
        if isinstance(value, (MemberDescriptorType, GetSetDescriptorType)):
            return ["descriptor", value.__name__]
        return None

    def _object(self, value: Any) -> list[Any]:
        """Describes an object by the state that `pickle` stores."""
        try:
            reducer = copyreg.dispatch_table.get(type(value))
            reduced = reducer(value) if reducer else value.__reduce_ex__(4)
        except Exception as error:
            raise self._unstable(value) from error
        if isinstance(reduced, str):
            wrapped = getattr(value, "__wrapped__", None)
            return ["global", self.described(type(value)), str(getattr(value, "__module__", "")), reduced, self.described(wrapped)]
        parts = [list(part) if place > 2 and isinstance(part, Iterator) else part for place, part in enumerate(reduced)]
        return ["object", self.described(type(value)), *map(self.described, parts)]


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _digest_of_file(path: str | None) -> str:
    try:
        return _digest(Path(path or "").read_bytes())
    except OSError:
        return ""


def _nested(code: CodeType) -> Iterator[CodeType]:
    """Yields a function's code, and that of the functions in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _nested(constant)


def _names(code: CodeType) -> Iterator[str]:
    for each in _nested(code):
        yield from each.co_names


def _reads(code: CodeType) -> tuple[set[str], set[str]]:
    """The globals that a function reads, and the modules that it may import, with a dot for each level where they are relative."""
    loaded: set[str] = set()
    imported: set[str] = set()
    for each in _nested(code):
        arguments: list[Any] = []
        module = ""
        for instruction in dis.get_instructions(each):
            if instruction.opname == "EXTENDED_ARG":
                continue
            if instruction.opname == "IMPORT_NAME":
                # The level and the names that are imported are loaded before.
                level = next((argument for argument in arguments[-2:-1] if type(argument) is int), 0)
                module = "." * level + instruction.argval
                imported.add(module)
            elif instruction.opname == "IMPORT_FROM":
                # What is imported from a package may be a module in it.
                imported.add(f"{module}{'' if module.endswith('.') else '.'}{instruction.argval}")
            elif instruction.opname.startswith("LOAD_") and instruction.opname.endswith(("GLOBAL", "GLOBALS", "NAME")):
                loaded.add(instruction.argval)
            arguments.append(instruction.argval)
    return loaded, imported


def _imported(name: str, package: str) -> list[str]:
    """A module that a function imports when it is called. It may not be loaded yet, so that its file alone can be told."""
    try:
        module = importlib.util.resolve_name(name, package)
        top = module.partition(".")[0]
        # Python imports a package to find what is in it, which the version of an installed one does not need.
        if not _is_own(top, _file_of(top)):
            return [module, _version(top)]
        path = _file_of(module)
    except Exception:  # that of a package on the way, or there is no such module
        return [name]
    return [module, _digest_of_file(path) if _is_own(module, path) else _version(module)]


def _file_of(module: str) -> str | None:
    """The file of a module, if it has one.

    Raises:
        ImportError: There is no such module. A package that it is in may raise anything.
    """
    if module in sys.modules:
        path: str | None = getattr(sys.modules[module], "__file__", None)
        return path
    spec = importlib.util.find_spec(module)
    if spec is None:
        raise ImportError(module)
    return spec.origin


def _is_own(name: Any, path: str | None = None) -> bool:
    """Whether a module belongs to the user's program instead of an installed package."""
    if not isinstance(name, str) or name in ("__main__", "__mp_main__"):
        return True
    top = name.partition(".")[0]
    if top in sys.stdlib_module_names or top == "calib_rl":
        return False
    path = path or getattr(sys.modules.get(name), "__file__", None)
    return path is None or not {"site-packages", "dist-packages"} & set(Path(path).parts)


def _is_reachable(module: Any, qualname: str, value: Any) -> bool:
    found: Any = sys.modules.get(module)
    for name in qualname.split("."):
        found = getattr(found, name, None)
    return found is value


@functools.cache
def _version(module: str) -> str:
    top = module.partition(".")[0]
    if top in sys.stdlib_module_names:
        return f"{sys.version_info.major}.{sys.version_info.minor}"
    try:
        return metadata.version(top)
    except metadata.PackageNotFoundError:
        # The package has another name than the module, such as scikit-learn for sklearn.
        return ",".join(metadata.version(name) for name in sorted(set(metadata.packages_distributions().get(top, []))))
