"""The package as a whole: what a wheel holds, how it starts, who imports whom, who may print."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from importlib.resources import files
from pathlib import Path

import pytest
import typer.main

from coslobe.cli.main import app

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PLACES = {name: ROOT / folder for name, folder in PROJECT["tool"]["setuptools"]["package-dir"].items()}
MAY_IMPORT = {
    "core": set(),
    "spheresets": {"core"},
    "tables": {"core"},
    "render": {"core", "spheresets", "tables"},
    "evaluate": {"core", "spheresets", "tables", "render", "configs"},
    "cli": {"core", "spheresets", "tables", "render", "evaluate", "configs"},
    "configs": set(),
}
SOURCES = sorted(path for room in MAY_IMPORT for path in (ROOT / room).rglob("*.py"))
HEAVY = ["open3d", "pymeshlab", "trimesh", "matplotlib", "pyopencl", "scipy", "mitsuba", "OpenEXR", "PIL"]


def shipped(folder: Path) -> set[str]:
    """Everything in a room that belongs into the package, relative to the root of the tree."""
    found = (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    return {str(path.relative_to(ROOT)) for path in found}


@pytest.fixture(scope="session")
def wheel(tmp_path_factory) -> Path:
    """The wheel of this tree, built from a copy: setuptools leaves files behind where it builds."""
    copy, folder = tmp_path_factory.mktemp("tree"), tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    for room in MAY_IMPORT:
        shutil.copytree(ROOT / room, copy / room, ignore=shutil.ignore_patterns("__pycache__"))
    code = f"from setuptools.build_meta import build_wheel; build_wheel({str(folder)!r})"
    subprocess.run([sys.executable, "-c", code], cwd=copy, check=True, capture_output=True)
    return next(folder.glob("coslobe-*.whl"))


def test_wheel_holds_every_file_of_the_rooms(wheel):
    inside = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    expected = {f"coslobe/{name}" for room in MAY_IMPORT for name in shipped(ROOT / room)}
    assert inside == expected
    for suffix in (".cl", ".yaml", ".html"):
        assert any(name.endswith(suffix) for name in inside)


def test_wheel_carries_the_licence(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)


@pytest.fixture(scope="session")
def installed(wheel, tmp_path_factory) -> Path:
    """The folder of programs of an environment where the wheel is installed.

    The packages that coslobe depends on are lent by the environment of the tests. Its editable coslobe is
    not: in a folder that a .pth file names, other .pth files are ignored.
    """
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False, symlinks=True)
    packages = next(folder.glob("lib/python*/site-packages"))
    (packages / "lent.pth").write_text(sysconfig.get_path("purelib") + "\n")
    programs = folder / "bin"
    pip = [sys.executable, "-m", "pip", "--quiet", "--python", str(programs / "python")]
    install = ["install", "--no-deps", "--no-index", "--ignore-installed", str(wheel)]
    subprocess.run([*pip, *install], check=True, capture_output=True)
    return programs


def run(*command: str | Path, cwd: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | variables
    words = [str(word) for word in command]
    return subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def test_installed_program_starts_outside_the_checkout(installed, tmp_path):
    version = run(installed / "coslobe", "--version", cwd=tmp_path)
    assert (version.returncode, version.stdout) == (0, f"coslobe {PROJECT['project']['version']}\n")
    devices = run(installed / "coslobe", "devices", "--json", cwd=tmp_path)
    assert devices.returncode == (0 if any(info["ok"] for info in json.loads(devices.stdout)) else 4)


def test_installed_package_finds_its_data(installed, tmp_path):
    names = {
        f"{package}:{path.name}"
        for package, place in PLACES.items()
        for path in place.iterdir()
        if path.is_file() and path.suffix != ".py"
    }
    code = (
        "import sys\nfrom importlib.resources import files\n"
        "for name in sys.argv[1:]:\n"
        "    package, file = name.split(':')\n"
        "    assert files(package).joinpath(file).read_bytes(), name\n"
        "import coslobe.core; print(coslobe.core.__file__)\n"
    )
    done = run(installed / "python", "-c", code, *names, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert Path(done.stdout.strip()).is_relative_to(installed.parent)


def test_editable_install_maps_to_this_tree():
    for package, place in PLACES.items():
        assert Path(str(files(package).joinpath("__init__.py"))).samefile(place / "__init__.py")


def test_every_folder_of_modules_is_a_package():
    folders = {path.parent for path in SOURCES} | {path.parent for path in ROOT.glob("render/**/*.cl")}
    assert folders == set(PLACES.values())
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == set(PLACES)


# A system library that is missing, simulated by an Open3D that cannot be imported.


def test_missing_system_library_is_one_clear_line(installed, tmp_path):
    reason = "libusb-1.0.so.0: cannot open shared object file: No such file or directory"
    (tmp_path / "open3d.py").write_text(f"raise ImportError({reason!r})\n")
    scene = """
        coslobe: 1
        camera: {look_at: {origin: [0, 2, 3], target: [0, 0, 0]}, fov: 40}
        image: {width: 8, height: 8}
        materials: {floor: {lambert: {albedo: 0.5}}}
        lights: {key: {sphere: {center: [0, 3, 0], radius: 0.5, radiance: 10}}}
        objects: {bunny: {mesh: "sample:bunny", material: floor}}
    """
    (tmp_path / "scene.yaml").write_text(scene)
    done = run(installed / "coslobe", "render", "scene.yaml", cwd=tmp_path, PYTHONPATH=str(tmp_path))
    assert done.returncode == 1
    assert f"error: a system library is missing ({reason})\n" in done.stderr
    assert re.search(r"^try: apt-get install .*\blibusb-1\.0-0\b", done.stderr, re.MULTILINE)
    assert "Traceback" not in done.stderr + done.stdout


# Start-up.


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["render", "--help"]])
def test_help_loads_no_heavy_package(arguments, tmp_path):
    code = (
        "import sys\nfrom coslobe.cli.main import app\n"
        f"app({arguments!r}, standalone_mode=False)\n"
        f"print('loaded:', [name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = run(sys.executable, "-c", code, cwd=tmp_path)
    assert done.stdout.splitlines()[-1] == "loaded: []", done.stderr


# Who may do what.


def imported_rooms(tree: ast.AST) -> set[str]:
    """Rooms that a module imports, at its top or inside functions."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name.split(".")[1] for name in names if name.startswith("coslobe.")}


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_dependencies_point_one_way(path):
    room = path.relative_to(ROOT).parts[0]
    assert imported_rooms(ast.parse(path.read_text())) <= MAY_IMPORT[room] | {room}


TERMINAL = re.compile(
    r"print|input|exit|quit|SystemExit|sys\.exit|os\._exit|(sys\.)?(stdout|stderr)\.write|typer\..*|console\..*"
)


def prints_or_exits(tree: ast.Module) -> list[str]:
    """Where a module talks to the terminal or ends the process, `__main__` blocks aside."""
    parts = [
        part for part in tree.body if not (isinstance(part, ast.If) and "__main__" in ast.dump(part.test))
    ]
    nodes = [node for part in parts for node in ast.walk(part)]
    used = [node.func for node in nodes if isinstance(node, ast.Call)]
    used += [node.exc for node in nodes if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Name)]
    return [
        f"line {name.lineno}: {ast.unparse(name)}" for name in used if TERMINAL.fullmatch(ast.unparse(name))
    ]


@pytest.mark.parametrize(
    "path",
    [path for path in SOURCES if path.relative_to(ROOT).parts[0] != "cli"],
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_only_the_command_line_prints_or_exits(path):
    assert prints_or_exits(ast.parse(path.read_text())) == []


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("def f():\n    print(1)", 1),
        ("import sys\ndef f():\n    sys.exit(1)", 1),
        ("raise SystemExit(2)", 1),
        ("raise SystemExit", 1),
        ("import sys\nsys.stdout.write('')", 1),
        ("if __name__ == '__main__':\n    print(1)", 0),
        ("blueprint(1)\nself.exit()", 0),
    ],
)
def test_the_scan_finds_what_it_looks_for(source, count):
    assert len(prints_or_exits(ast.parse(source))) == count


# What the documentation says exists.


def commands() -> dict[str, set[str]]:
    """Options of each command, "tables build" included."""
    found = {}

    def collect(group, prefix):
        for name, command in group.commands.items():
            if hasattr(command, "commands"):
                collect(command, f"{prefix}{name} ")
            else:
                found[prefix + name] = {option for parameter in command.params for option in parameter.opts}

    collect(typer.main.get_command(app), "")
    return found


DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def typed(document: Path) -> list[list[str]]:
    """The words of every command line in a document: lines of code blocks, and code within text."""
    fenced, lines = False, []
    for line in document.read_text().splitlines():
        if line.lstrip().startswith("```"):
            fenced = not fenced
        else:
            lines += [line] if fenced else re.findall(r"`([^`]+)`", line)
    return [line.split(" #")[0].split() for line in lines]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_documented_commands_exist(document):
    known = commands()
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for words in typed(document):
        if words[:1] == ["make"] and len(words) > 1:
            assert words[-1] in targets, words
        if words[:1] == ["coslobe"] and len(words) > 1 and words[1].islower() and words[1].isalpha():
            name = " ".join(words[1:3]) if words[1] == "tables" else words[1]
            assert name in known, words
            options = {word.split("=")[0] for word in words if re.fullmatch(r"-[a-z]|--[a-z-]+(=.*)?", word)}
            assert options <= known[name] | {"--help"}, words


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_documented_files_exist(document):
    targets = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", document.read_text())
    assert [target for target in targets if not (document.parent / target).exists()] == []


def test_documents_that_the_code_cites_exist():
    sources = [
        path for room in MAY_IMPORT for path in (ROOT / room).rglob("*") if path.suffix in (".py", ".cl")
    ]
    cited = {name for path in sources for name in re.findall(r"\bdocs/[\w/]+\.md", path.read_text())}
    assert {name for name in cited if not (ROOT / name).exists()} == set()


def test_index_lists_every_document():
    index = (ROOT / "docs" / "README.md").read_text()
    names = [path.name for path in (ROOT / "docs").glob("*.md") if path.name != "README.md"]
    assert [name for name in names if f"({name})" not in index] == []


@pytest.mark.parametrize("language", ["Python", "OpenCL"])
def test_names_of_the_notation_exist(language):
    pattern = {"Python": "*.py", "OpenCL": "*.cl"}[language]
    sources = "\n".join(path.read_text() for room in MAY_IMPORT for path in (ROOT / room).rglob(pattern))
    known = set(re.findall(r"\w+", sources))
    column, names = None, set()
    for line in (ROOT / "docs" / "notation.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if language in cells:
            column = cells.index(language)
        elif len(cells) == 1:
            column = None
        elif column is not None:
            names |= {part for name in re.findall(r"`([^`]+)`", cells[column]) for part in name.split(".")}
    assert names
    assert names - known == set()


def test_continuous_integration_runs_what_the_readme_says():
    script = (ROOT / ".ci" / "run").read_text()
    assert re.findall(r"^make \w+$", script, re.MULTILINE) == ["make check", "make test"]
    assert "`make test`" in (ROOT / "README.md").read_text()


# The set-up.


def test_constraints_pin_every_dependency_exactly():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9._]+", pin) for pin in pins)
    pinned = {pin.split("==")[0].lower().replace("_", "-") for pin in pins}
    project = PROJECT["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    linux = [entry for group in groups for entry in group if "!= 'linux'" not in entry]
    assert {re.split(r"[^\w.-]", entry)[0].lower() for entry in linux} <= pinned


def test_older_python_is_refused_with_the_next_step(tmp_path):
    code = (
        "import sys, runpy\n"
        "sys.version_info = (3, 10, 0, 'final', 0)\n"
        f"runpy.run_path({str(ROOT / 'scripts' / 'prepare.py')!r}, run_name='__main__')"
    )
    done = run(sys.executable, "-c", code, cwd=tmp_path)
    assert done.returncode == 1
    assert "Python 3.11 or newer is needed" in done.stderr
    assert "make PYTHON=" in done.stderr
