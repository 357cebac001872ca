"""The docstrings of the code: functions with many parameters say what each of them is."""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("voxdepth", "sim", "swarm", "scenarios", "examples", "ros2")
MANY = 4
"""From this number of parameters on, a docstring describes them."""

Definition = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Function:
    """A function of a module, and the class that defines it."""

    file: str
    node: Definition
    owner: ast.ClassDef | None
    is_public: bool

    @property
    def title(self) -> str:
        name = self.node.name if self.owner is None else f"{self.owner.name}.{self.node.name}"
        return f"{self.file}:{self.node.lineno} {name}"

    @property
    def parameters(self) -> list[ast.arg]:
        """In the order of the definition; no `self` or `cls`."""
        is_static = any(ast.unparse(decorator) == "staticmethod" for decorator in self.node.decorator_list)
        of = self.node.args
        positional = [*of.posonlyargs, *of.args][self.owner is not None and not is_static :]
        return [arg for arg in (*positional, of.vararg, *of.kwonlyargs, of.kwarg) if arg is not None]

    @property
    def names(self) -> list[str]:
        """Names of the parameters."""
        return [arg.arg for arg in self.parameters]

    @property
    def is_compiled(self) -> bool:
        """Whether Numba or Warp compiles it."""
        decorators = [ast.unparse(decorator) for decorator in self.node.decorator_list]
        return any(re.match(r"compiled|\w+\.kernel|\w+\.func", decorator) for decorator in decorators)

    @property
    def docstring(self) -> str:
        """That of the class if this makes an object of it."""
        of_class = self.owner if self.owner is not None and self.node.name == "__init__" else None
        return ast.get_docstring(self.node) or (of_class and ast.get_docstring(of_class)) or ""


def parsed() -> dict[str, ast.Module]:
    paths = (path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py")))
    return {path.relative_to(ROOT).as_posix(): ast.parse(path.read_text(), str(path)) for path in paths}


MODULES = parsed()


def defined(file: str, inside: ast.Module | ast.ClassDef, is_public: bool) -> Iterator[Function]:
    """Those of a module, without those within others, which nobody else can call."""
    for node in inside.body:
        if isinstance(node, ast.ClassDef):
            yield from defined(file, node, is_public and not node.name.startswith("_"))
        elif isinstance(node, Definition):
            owner = inside if isinstance(inside, ast.ClassDef) else None
            is_named = node.name == "__init__" or not node.name.startswith("_")
            yield Function(file, node, owner, is_public and is_named)


def functions(modules: dict[str, ast.Module]) -> list[Function]:
    public = {file: not re.search(r"(^|/)_(?!_init__)", file) for file in modules}
    return [function for file, module in modules.items() for function in defined(file, module, public[file])]


def described(docstring: str) -> list[str] | None:
    """Names in the section `Args:` of a docstring; None where it has no such section."""
    section = re.search(r"^Args:\n((?:[ ]+.*\n?|\n)*)", docstring, re.MULTILINE)
    return None if section is None else re.findall(r"^ {4}\*{0,2}(\w+)(?: \(.*?\))?: \S", section[1], re.MULTILINE)


def overrides(function: Function, classes: dict[str, ast.ClassDef]) -> bool:
    """Whether a base class of the project has the same method, which must describe its parameters itself."""
    bases = [] if function.owner is None or function.node.name == "__init__" else function.owner.bases[:]
    while bases:
        base = classes.get(ast.unparse(bases.pop()).split("[")[0].split(".")[-1])
        if base is not None and not base.name.startswith("_"):
            methods = [Function("", node, base, True) for node in base.body if isinstance(node, Definition)]
            if any((m.node.name, m.names) == (function.node.name, function.names) for m in methods):
                return True
            bases += base.bases
    return False


def has_help(annotation: ast.expr | None, aliases: dict[str, ast.expr]) -> bool:
    """Whether it is an `Annotated` with an option or an argument of the command line that has a help."""
    if isinstance(annotation, ast.Name):
        annotation = aliases.get(annotation.id)
    calls = [] if annotation is None else [node for node in ast.walk(annotation) if isinstance(node, ast.Call)]
    options = [call for call in calls if ast.unparse(call.func) in {"typer.Option", "typer.Argument"}]
    return any(keyword.arg == "help" for option in options for keyword in option.keywords)


def faults(modules: dict[str, ast.Module]) -> list[str]:
    """What a docstring lacks, a line each."""
    nodes = [node for module in modules.values() for node in ast.walk(module)]
    classes = {node.name: node for node in nodes if isinstance(node, ast.ClassDef)}
    assigned = [node for module in modules.values() for node in module.body if isinstance(node, ast.Assign)]
    aliases = {name.id: node.value for node in assigned for name in node.targets if isinstance(name, ast.Name)}
    found = []
    for function in functions(modules):
        names, names_described = function.names, described(function.docstring)
        is_command = all(has_help(arg.annotation, aliases) for arg in function.parameters)
        must = len(names) >= MANY and (function.is_public or function.is_compiled)
        if names_described is not None and names_described != names:
            found.append(f"{function.title}: expected Args of {names}, got {names_described}")
        elif names_described is None and must and not is_command and not overrides(function, classes):
            found.append(f"{function.title}: {len(names)} parameters need Args: in the docstring")
    return found


def test_functions_with_many_parameters_describe_them() -> None:
    assert faults(MODULES) == []


GOOD = '''
def scale(image, factor, offset, *rest):
    """Scale it.

    Args:
        image: Shape (H, W).
        factor: A factor that needs a second line, as in
            one: two.
        offset: Added.
        *rest: More.

    Returns:
        It.
    """
'''


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        (GOOD, ""),
        (GOOD.replace("        offset: Added.\n", ""), "got ['image', 'factor', 'rest']"),
        (GOOD.replace("offset: Added", "shift: Added"), "got ['image', 'factor', 'shift', 'rest']"),
        (GOOD.replace("(image, factor", "(factor, image"), "expected Args of ['factor', 'image'"),
        (GOOD.replace("offset: Added.", "offset:"), "got ['image', 'factor', 'rest']"),
        (GOOD.replace("Args:", "Parameters:"), "4 parameters need Args:"),
        (GOOD.replace("Args:", "Parameters:").replace("scale", "_scale"), ""),
        ('@compiled_part(f4(f4))\ndef _add(a, b, c, d):\n    """Add."""', "4 parameters need Args:"),
        ('@wp.kernel\ndef _add(a, b, c, d):\n    """Add."""', "4 parameters need Args:"),
        ("class A:\n    def f(self, a, b, c): ...", ""),
        ("class A:\n    def f(self, a, b, c, *, d): ...", "A.f: 4 parameters need Args:"),
        ("class A:\n    @staticmethod\n    def f(a, b, c, d): ...", "A.f: 4 parameters need Args:"),
        ("class _A:\n    def f(self, a, b, c, d): ...", ""),
        ('class A:\n    """It.\n\n    Args:\n        a: A.\n    """\n    def __init__(self, a, b): ...', "got ['a']"),
    ],
)
def test_the_check_finds(source: str, fault: str) -> None:
    found = faults({"module.py": ast.parse(source)})
    assert [fault in line for line in found] == [True] * bool(fault), found


@pytest.mark.parametrize(
    ("parameters", "n_faults"), [("self, image, factor, offset, *rest", 0), ("self, image, factor, shift, *rest", 1)]
)
def test_a_method_need_not_repeat_what_its_base_class_describes(parameters: str, n_faults: int) -> None:
    base = f"class Base:{GOOD.replace('image,', 'self, image,')}".replace("\n", "\n    ")
    derived = f"class Derived(Base):\n    def scale({parameters}): ..."
    assert len(faults({"base.py": ast.parse(base), "derived.py": ast.parse(derived)})) == n_faults
    assert len(faults({"derived.py": ast.parse(derived)})) == 1


def test_a_command_describes_its_parameters_in_their_help() -> None:
    source = "Seed = Annotated[int, typer.Option(help='H')]\ndef run(a: Seed, b: Seed, c: Seed, d: {}): ..."
    assert faults({"a.py": ast.parse(source.format("Seed"))}) == []
    assert len(faults({"a.py": ast.parse(source.format("Annotated[int, typer.Option(min=1)]"))})) == 1
