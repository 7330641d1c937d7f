"""Machine code on disk: reused where nothing that it can reach has changed, and only there."""

from __future__ import annotations

import ast
import json
import os
import pickle
import platform
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import pytest

import plane_kernels
import plane_logic
from pareto_ltl import kernels
from plane_kernels.collision_risk import step_allowed
from typed_kernels import code_cache, code_files, shipped_code
from typed_kernels.code_cache import FOREIGN, code_stamp, reachable_sources
from typed_kernels.jit import IMPLEMENTATIONS, by_type, implements, source_file
from typed_kernels.packages import PACKAGES
from unmeasured import untraced

KERNELS = Path(kernels.__file__).parent
PLANE_KERNELS = Path(plane_kernels.__file__).parent
PLANE_LOGIC = Path(plane_logic.__file__).parent
FOLDERS = KERNELS, PLANE_KERNELS, PLANE_LOGIC
TYPED_KERNELS = Path(code_cache.__file__).parent
# One square cell. Each process of these tests imports again, so little is imported. One test renames Cells.
PROGRAM = """
import numpy as np
from plane_kernels.geometry import locate_cells
from plane_kernels import types
normals = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
square = types.Faces(np.array([0, 4]), normals, np.ones(4))
kind = types.Cells if hasattr(types, "Cells") else types.CellTable
cells = kind(-1.0, -1.0, 1.0, 1.0, 1, np.array([0, 1]), np.array([0]), square)
print(locate_cells(cells, np.array([[1e9, 1e9], [0.5, 0.5]])).tolist())
print(sum(locate_cells.stats.cache_hits.values()), sum(locate_cells.stats.cache_misses.values()))
"""
LOCATED = "[-1, 0]"  # what it prints first


FACTS = """
import json
from typed_kernels.shipped_code import installation, process_target
print(json.dumps(installation() | {"target": process_target()}))
"""


def names(file: Path) -> set[str]:
    return {source.stem for source in reachable_sources(file)}


def test_a_file_reaches_what_it_imports_directly_or_through_others():
    assert {"growth", "tree", "parents", "collision_risk", "gaussian", "data", "types", "jit"} <= names(
        KERNELS / "growth.py"
    )
    assert not {"margin", "flight", "visibility", "importance"} & names(KERNELS / "growth.py")
    assert "growth" not in names(PLANE_LOGIC / "margin.py")


def test_modules_that_a_file_imports_as_such_are_reached():
    assert {"claim_lists", "claim_rows"} <= names(PLANE_LOGIC / "margin.py")


@pytest.mark.parametrize(
    "file",
    sorted(file for folder in (*FOLDERS, TYPED_KERNELS) for file in folder.glob("*.py")),
    ids=lambda file: f"{file.parent.name}.{file.stem}",
)
def test_the_pattern_of_imports_finds_what_the_parser_finds(file):
    found = [node for node in ast.walk(ast.parse(file.read_bytes())) if isinstance(node, ast.ImportFrom)]
    modules = {node.module for node in found}
    modules |= {f"{node.module}.{alias.name}" for node in found for alias in node.names}
    reached = {
        folder / f"{name.rpartition('.')[2]}.py"
        for package, folder in PACKAGES.items()
        for name in modules
        if f"{package}." in name
    }
    assert {source for source in reached if source.is_file()} | {file} == {
        *code_cache.imported_kernels(file),
        file,
    }


ENTRIES = [
    file
    for file in sorted(file for folder in FOLDERS for file in folder.glob("*.py"))
    if re.search(r"^@(entry|allocating)", file.read_text(), re.M)
]


@pytest.mark.parametrize("file", ENTRIES, ids=lambda file: file.stem)
def test_a_file_that_reaches_a_choice_reaches_the_code_of_every_model(file):
    reached = reachable_sources(file)
    for chosen in IMPLEMENTATIONS.values():
        file = source_file(chosen.chosen)
        if file in reached:
            codes = {source_file(code) for code in chosen.implementations.values()}
            assert codes <= reached | FOREIGN.get(file, set())


def test_code_that_others_add_to_a_model_changes_the_stamps_of_what_can_reach_it(monkeypatch):
    reaching, other = KERNELS / "growth.py", PLANE_KERNELS / "visibility.py"
    before = code_stamp(reaching), code_stamp(other)
    assert PLANE_KERNELS / "collision_risk.py" in reachable_sources(reaching) - reachable_sources(other)
    monkeypatch.setitem(FOREIGN, PLANE_KERNELS / "collision_risk.py", set())
    chosen = IMPLEMENTATIONS[step_allowed]
    monkeypatch.setattr(chosen, "implementations", dict(chosen.implementations))
    implements(step_allowed, complex)(lambda bound, before, here: True)
    assert FOREIGN[PLANE_KERNELS / "collision_risk.py"] == {Path(__file__)}
    assert code_stamp(reaching) != before[0]
    assert code_stamp(other) == before[1]


def test_a_function_of_another_package_changes_no_stamp():
    before = code_stamp(KERNELS / "growth.py")

    @by_type
    def volume(model):
        """Volume of a model."""

    implements(volume, float)(lambda model: model)
    assert Path(__file__) not in FOREIGN
    assert code_stamp(KERNELS / "growth.py") == before


def test_imports_of_other_packages_of_kernels_and_of_neighbours_are_followed(tmp_path, monkeypatch):
    for name in ("ours/one.py", "ours/two.py", "ours/three.py", "theirs/four.py", "plain/five.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "ours" / "one.py").write_text(
        "from .two import f\nfrom . import three  # a module\n"
        "from theirs.four import g\nfrom plain.five import h"
    )
    monkeypatch.setitem(PACKAGES, "ours", tmp_path / "ours")
    monkeypatch.setitem(PACKAGES, "theirs", tmp_path / "theirs")
    reached = reachable_sources(tmp_path / "ours" / "one.py")
    assert {source.stem for source in reached} == {"one", "two", "three", "four"}


def test_a_package_of_kernels_is_known_by_its_first_kernel():
    assert tuple(PACKAGES[name] for name in ("pareto_ltl.kernels", "plane_kernels", "plane_logic")) == FOLDERS
    assert not {"pareto_ltl", "pareto_ltl.planning", "numpy"} & set(PACKAGES)


def test_one_line_on_a_terminal_names_the_program_whichever_package_compiles_first(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    code_cache._say_compiling.cache_clear()  # noqa: SLF001 - it speaks once per process
    for place in (PLANE_KERNELS, KERNELS):
        code_cache._say_compiling(shipped_code.unusable_reason(place))  # noqa: SLF001
    assert capsys.readouterr().err == f"pareto-ltl: {code_cache.COMPILING}\n"


def test_different_files_have_different_stamps():
    assert code_stamp(KERNELS / "growth.py") != code_stamp(KERNELS / "flight.py")


@dataclass
class Program:
    """PROGRAM on a copy of the package, with a cache of its own."""

    folder: Path
    said: str = ""

    @property
    def kernels(self) -> Path:
        return self.folder / "src" / "pareto_ltl" / "kernels"

    @property
    def plane(self) -> Path:
        return self.folder / "src" / "plane_kernels"

    @property
    def code(self) -> Path:
        return self.folder / "code"

    def run(self, program: str = PROGRAM, **changes: str) -> str:
        """The output of ``program``; ``said`` is what it writes to the error stream."""
        surroundings = untraced(
            PYTHONPATH=str(self.kernels.parents[1]), NUMBA_DISABLE_JIT="0", NUMBA_CACHE_DIR=str(self.code),
            PYTHONDONTWRITEBYTECODE="1", **changes,
        )  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-c", program], env=surroundings, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        self.said = done.stderr
        return done.stdout

    def __call__(self, **changes: str) -> str:
        """Whether the code was on disk: ``reused`` or ``compiled``."""
        found, counts = self.run(**changes).splitlines()
        assert found == LOCATED
        return {"1 0": "reused", "0 1": "compiled"}[counts]

    def files(self) -> list[Path]:
        return sorted(self.code.rglob("*locate_cells*.nbc"))

    @property
    def list_of_code(self) -> Path:
        return self.plane / "machine_code" / shipped_code.MANIFEST

    def change_list(self, **values: object) -> None:
        """Change values of the list of the code in the package."""
        self.list_of_code.write_text(json.dumps(json.loads(self.list_of_code.read_text()) | values))

    def ship(self) -> None:
        """Put the code of PROGRAM for the baseline into the package, as a wheel has it."""
        place = self.plane / "machine_code"
        named = {"NUMBA_CPU_NAME": shipped_code.BASELINES[platform.machine()][0], "NUMBA_CPU_FEATURES": ""}
        assert self(**named) == "compiled"
        place.mkdir()
        for file in self.files():
            file.rename(place / file.name)
        facts = json.loads(self.run(FACTS, **named))
        files = {file.name: sha256(file.read_bytes()).hexdigest() for file in place.iterdir()}
        self.list_of_code.write_text(json.dumps(facts | {"files": files}))


def copied(folder: Path) -> Program:
    """A copy of the package in ``folder``."""
    leave_out = shutil.ignore_patterns("__pycache__", "machine_code")
    for package in (KERNELS.parent, PLANE_KERNELS, PLANE_LOGIC, TYPED_KERNELS):
        shutil.copytree(package, folder / "src" / package.name, ignore=leave_out)
    for name in ("conf", "pipelines"):
        shutil.copytree(KERNELS.parents[2] / name, folder / name)
    return Program(folder)


@pytest.fixture
def program(tmp_path):
    return copied(tmp_path)


def test_a_change_compiles_anew_what_it_can_reach_and_nothing_else(program):
    assert program() == "compiled"
    assert program() == "reused"

    other = program.kernels / "flight.py"
    other.write_text(other.read_text() + "\n# another kernel\n")
    assert program() == "reused"

    helper = program.plane / "types.py"  # locate_cells is in geometry.py, which imports it
    helper.write_text(helper.read_text() + "\n# a file that it reaches\n")
    assert program() == "compiled"
    assert program() == "reused"


def test_code_for_types_that_are_gone_is_removed_and_never_read(program):
    """A pickle names types: reading one of a type without a class would end the program."""
    assert program() == "compiled"
    old = program.files()
    assert old
    for source in program.plane.parent.rglob("*.py"):
        source.write_text(re.sub(r"\bCells\b", "CellTable", source.read_text()))
    assert program() == "compiled"
    assert program() == "reused"
    assert not any(file.exists() for file in old)


def damage(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-100])


def open_to_others(file: Path) -> None:
    file.chmod(0o666)


def replace_by_pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


@pytest.mark.parametrize(("harm", "reason"), [(damage, "it is damaged"), (replace_by_pipe, "it is no file")])
def test_a_damaged_or_foreign_file_is_not_executed_and_one_line_says_so(program, harm, reason):
    assert program() == "compiled"
    (file,) = program.files()
    harm(file)
    assert program() == "compiled"
    assert program.said.count("is not used") == 1
    assert program.said.count("machine code cannot be kept") == (harm is replace_by_pipe)
    assert f"{file} is not used: {reason}" in program.said
    if harm is not replace_by_pipe:  # which nothing replaces
        assert program() == "reused"


@pytest.mark.parametrize(
    ("harm", "reason"),
    [(damage, "it is damaged"), (cut, "it is damaged"), (open_to_others, "others may write it (mode 666)"),
     (replace_by_pipe, "it is no file")],
)  # fmt: skip
def test_a_damaged_or_foreign_file_has_no_content_and_one_line_says_so(tmp_path, caplog, harm, reason):
    file, source, content = tmp_path / "kernel.nbc", PLANE_KERNELS / "geometry.py", bytes(range(256))
    code_files.write_code(file, source, "kernel", content)
    assert code_files.read_code(file, source, "kernel") == content
    assert not caplog.messages
    harm(file)
    for _ in range(2):
        assert code_files.read_code(file, source, "kernel") is None
    (line,) = caplog.messages
    assert f"{file} is not used: {reason}" in line


def test_the_code_of_one_kernel_is_not_that_of_another_with_a_valid_checksum(tmp_path, caplog):
    file, source = tmp_path / "kernel.nbc", PLANE_KERNELS / "geometry.py"
    code_files.write_code(file, source, "geometry.locate_cells", b"code")
    assert code_files.read_code(file, source, "geometry.locate_cells") == b"code"
    assert code_files.read_code(file, source, "geometry.nearest") is None
    (line,) = caplog.messages
    assert f"{file} is not used: it is the code of another kernel" in line


NORTHING = """
from plane_kernels.types import Point
from typed_kernels.jit import entry


@entry
def north(point):
    return point[1]


print(north(Point(3.0, 4.0)), sum(north.stats.cache_misses.values()))
"""


def test_a_change_of_types_in_another_package_compiles_what_imports_them(program):
    """The package of the types has no kernel in this process."""
    (program.kernels / "northing.py").write_text(NORTHING)
    use = "from pareto_ltl.kernels import northing"
    assert [program.run(use).split(), program.run(use).split()] == [["4.0", "1"], ["4.0", "0"]]
    helper = program.plane / "types.py"
    helper.write_text(helper.read_text() + "\n# a file that it reaches\n")
    assert [program.run(use).split(), program.run(use).split()] == [["4.0", "1"], ["4.0", "0"]]


DOUBLING = """
from typed_kernels.jit import entry


@entry
def twice(x):
    return 2.0 * x


@entry
def thrice(x):
    return 3.0 * x
"""
USE_BOTH = """
from pareto_ltl.kernels.doubling import thrice, twice
print(twice(3.0), thrice(3.0))
print(sum(sum(kernel.stats.cache_misses.values()) for kernel in (twice, thrice)), "compiled")
"""


def test_a_file_in_the_place_of_another_kernels_is_compiled_and_not_called(program):
    """The files of two kernels of equal types are exchanged, each with its valid checksum."""
    (program.kernels / "doubling.py").write_text(DOUBLING)
    assert program.run(USE_BOTH).splitlines() == ["6.0 9.0", "2 compiled"]
    assert program.run(USE_BOTH).splitlines() == ["6.0 9.0", "0 compiled"]
    twice, thrice = (next(program.code.rglob(f"*.{name}-*.nbc")) for name in ("twice", "thrice"))
    one, two = twice.read_bytes(), thrice.read_bytes()
    twice.write_bytes(two)
    thrice.write_bytes(one)
    assert program.run(USE_BOTH).splitlines() == ["6.0 9.0", "2 compiled"]
    assert program.said.count("it is the code of another kernel") == 1  # one line for a folder
    assert program.run(USE_BOTH).splitlines() == ["6.0 9.0", "0 compiled"]


def test_code_in_a_folder_that_others_can_write_is_neither_read_nor_written(program):
    assert program() == "compiled"
    (file,) = program.files()
    file.parent.chmod(0o777)
    assert program() == "compiled"
    assert f"{file} is not used: its folder: others may write it (mode 777)" in program.said
    assert program.said.count("machine code cannot be kept") == 1
    file.parent.chmod(0o755)
    assert program() == "reused"


def test_a_file_of_numba_itself_is_not_read(program):
    assert program() == "compiled"
    (file,) = program.files()
    file.write_bytes(pickle.dumps(("0.0", "code")))
    assert program() == "compiled"
    assert program() == "reused"


def test_a_folder_that_cannot_be_written_is_one_warning(program):
    program.code.write_text("a file where a folder is needed")
    assert program() == "compiled"
    assert program.said.count("machine code cannot be kept") == 1
    assert str(program.code) in program.said
    assert len(program.said.strip().splitlines()) == 1


LIMITED = f"""
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
{PROGRAM}
"""


def test_a_full_disk_is_one_warning_and_leaves_nothing(program):
    output = program.run(LIMITED)
    assert output.splitlines() == [LOCATED, "0 1"]
    assert program.said.count("machine code cannot be kept") == 1
    assert not [file for file in program.code.rglob("*") if file.is_file()]
    assert program() == "compiled"


KILLED = f"""
import os
os.replace = lambda *paths: os._exit(9)
{PROGRAM}
"""


def test_a_process_that_is_killed_while_it_writes_leaves_no_code_and_its_draft_is_removed(program):
    with pytest.raises(AssertionError):
        program.run(KILLED)
    (draft,) = (file for file in program.code.rglob("*") if file.is_file())
    assert draft.name.startswith(".")
    os.utime(draft, (1e9, 1e9))
    assert program() == "compiled"
    assert [file.name for file in program.code.rglob("*") if file.is_file()] == [program.files()[0].name]
    assert program() == "reused"


# --- code that a wheel brings ------------------------------------------------------------------


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A copy of the package with the code that a wheel would bring."""
    if platform.machine() not in shipped_code.BASELINES:
        pytest.skip(f"there is no baseline for {platform.machine()}")
    program = copied(tmp_path_factory.mktemp("wheel"))
    program.ship()
    return program


@pytest.fixture
def shipped(wheel, tmp_path):
    shutil.copytree(wheel.folder, tmp_path / "copy")
    return Program(tmp_path / "copy")


def test_code_in_the_package_is_used_and_nothing_is_written(shipped):
    before = {file: file.read_bytes() for file in shipped.folder.rglob("*") if file.is_file()}
    assert shipped() == "reused"
    assert shipped.said == ""
    assert {file: file.read_bytes() for file in shipped.folder.rglob("*") if file.is_file()} == before


def test_code_in_the_package_that_is_damaged_or_not_listed_is_compiled(shipped):
    (file,) = (shipped.plane / "machine_code").glob("*.nbc")
    whole = file.read_bytes()
    damage(file)
    assert shipped() == "compiled"
    assert f"{file} is not used: it is damaged" in shipped.said
    shutil.rmtree(shipped.code)

    file.write_bytes(code_files.packed_code("kernel", b"other code"))  # undamaged, but not as listed
    assert shipped() == "compiled"
    shutil.rmtree(shipped.code)

    file.write_bytes(whole)
    assert shipped() == "reused"


def test_code_in_the_package_for_another_source_is_compiled(shipped):
    helper = shipped.plane / "types.py"
    helper.write_text(helper.read_text() + "\n# changed after the wheel was built\n")
    assert shipped() == "compiled"


def test_code_in_the_package_for_something_else_is_compiled_and_one_line_says_so(shipped):
    shipped.change_list(numba="0.1.2")
    assert shipped() == "compiled"
    assert "it is for numba 0.1.2" in shipped.said
    assert len(shipped.said.strip().splitlines()) == 1
    assert shipped() == "reused"
    assert shipped.said == ""


def test_a_list_that_cannot_be_read_is_one_line(shipped):
    shipped.list_of_code.write_text("[]")
    assert shipped() == "compiled"
    assert shipped.said.count("the machine code of this installation is not used") == 1


UNUSED = "the machine code of this installation is not used: "


@pytest.fixture
def list_in(wheel, tmp_path, monkeypatch):
    """The manifest of a copy of the code that a wheel would bring, which this process looks for."""
    shutil.copytree(wheel.list_of_code.parent, tmp_path / "machine_code")
    shipped_code._shipped.cache_clear()  # noqa: SLF001 - it reads the list once per process
    yield tmp_path / "machine_code" / shipped_code.MANIFEST
    shipped_code._shipped.cache_clear()  # noqa: SLF001


def test_code_for_this_installation_is_used(list_in):
    assert shipped_code.shipped_code(list_in.parents[1]) is not None
    assert shipped_code.unusable_reason(list_in.parents[1]) == ""


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [("numba", "0.1.2", "it is for numba 0.1.2"), ("python", "cpython-27", "it is for Python cpython-27"),
     ("target", ["x", "i386", ""], "it is for i386"), ("format", "x/9", "its format is x/9"),
     ("files", None, "its list cannot be read")],
)  # fmt: skip
def test_code_for_something_else_is_not_used_for_a_reason(list_in, key, value, reason):
    list_in.write_text(json.dumps(json.loads(list_in.read_text()) | {key: value}))
    assert shipped_code.shipped_code(list_in.parents[1]) is None
    assert shipped_code.unusable_reason(list_in.parents[1]).startswith(UNUSED + reason)


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000, '{"numba": 3}'])
def test_code_with_a_list_that_cannot_be_read_is_not_used(list_in, text):
    list_in.write_text(text)
    assert shipped_code.shipped_code(list_in.parents[1]) is None
    assert shipped_code.unusable_reason(list_in.parents[1]).startswith(UNUSED)


def test_a_user_who_names_a_processor_gets_code_for_it(shipped):
    assert shipped(NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == "compiled"
    assert "NUMBA_CPU_NAME is generic" in shipped.said


def test_a_processor_without_avx2_does_not_get_code_for_it(monkeypatch):
    manifest = shipped_code.installation() | {"target": ["x86_64-linux", "x86-64-v3", ""], "files": {}}
    monkeypatch.setattr(shipped_code.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(shipped_code.config, "CPU_NAME", None)
    features = dict.fromkeys(shipped_code.V3, True)
    monkeypatch.setattr(shipped_code.llvm, "get_host_cpu_features", lambda: features)
    assert shipped_code.mismatch(manifest) == ""
    monkeypatch.setattr(shipped_code.llvm, "get_host_cpu_features", lambda: features | {"avx2": False})
    assert shipped_code.mismatch(manifest) == "it is for x86-64-v3, and this processor lacks avx2"
