"""The package as it is installed: its name, its extras, its versions, the files around it."""

import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import neuro
from neuro.cli.start import by_name, shipped
from neuro.core import extras
from neuro.core.errors import ModelError
from neuro.core.extras import app, install

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CODE = [file for folder in ("neuro", "backends", "apps") for file in (ROOT / folder).rglob("*.py")]


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Install the package as far as its metadata go, from a place that pip has written down."""

    def put(origin):
        folder = tmp_path / "neuro_snn-0.1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text("Metadata-Version: 2.4\nName: neuro-snn\nVersion: 0.1.0\n")
        if origin is not None:
            (folder / "direct_url.json").write_text(json.dumps(origin))
        monkeypatch.syspath_prepend(tmp_path)

    return put


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        ({"url": "file:///home/me/neuro", "dir_info": {"editable": True}}, "pip install -e '/home/me/neuro[torch]'"),
        ({"url": "file:///home/me/neuro", "dir_info": {}}, "pip install '/home/me/neuro[torch]'"),
        ({"url": "file:///my%20work/it%27s", "dir_info": {}}, """pip install '/my work/it'"'"'s[torch]'"""),
        ({"url": "file:///tmp/neuro_snn.whl", "archive_info": {}}, "pip install '/tmp/neuro_snn.whl[torch]'"),
        ({"url": "https://host/neuro.git", "vcs_info": {}}, "pip install '.[torch]' in the folder of neuro's sources"),
        (None, "pip install 'neuro-snn[torch]'"),
    ],
)
def test_an_extra_is_installed_from_where_the_package_came(installed, origin, command):
    installed(origin)
    assert install("torch") == command


def test_without_metadata(monkeypatch):
    monkeypatch.setattr(extras, "DISTRIBUTION", "neuro-that-nobody-installed")
    assert install("torch") == "pip install '.[torch]' in the folder of neuro's sources"


def test_hints_name_extras_that_there_are():
    ways = r"install\(['\"](\w+)['\"]\)|needed\(\"[\w.]+\", \"(\w+)\""
    named = {"".join(found) for file in CODE for found in re.findall(ways, file.read_text())}
    assert {"compare", "torch", "rl", "bullet", "neo", "pandas"} <= named <= PROJECT["optional-dependencies"].keys()


def test_no_page_or_message_installs_the_package_of_that_name_on_the_index():
    pages = [ROOT / "README.md", ROOT / "Makefile", *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").iterdir()]
    wrong = re.compile(r"pip install [^\n]*\bneuro\b(?!['’]s)")
    assert [str(file) for file in (*CODE, *pages) if wrong.search(file.read_text())] == []


def test_names_and_versions_agree():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert PROJECT["name"] == extras.DISTRIBUTION
    assert neuro.__version__ == citation["version"]
    assert PROJECT["license"] == citation["license"] == "MIT"


def test_what_is_copied_is_built_into_the_package():
    """The wheel takes what lies in its folders and git does not ignore."""
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    copied = [*shipped("examples").values()]
    copied += [file for folder in shipped("templates").values() for file in by_name(folder).values()]
    assert len(copied) > 15
    ignored = {line.strip("/") for line in (ROOT / ".gitignore").read_text().split()}
    for file in map(Path, map(str, copied)):
        inside = file.relative_to(ROOT)
        assert inside.parts[0] in wheel["only-include"]
        assert not any(part.match(pattern) for part in (inside, *inside.parents) for pattern in ignored), inside


def test_every_python_that_is_promised_has_its_constraints():
    told = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    assert sorted(file.stem for file in (ROOT / "constraints").glob("*.txt")) == told
    assert PROJECT["requires-python"] == f">={told[0]}"


@pytest.mark.parametrize("file", sorted((ROOT / "constraints").glob("*.txt")), ids=lambda file: file.stem)
def test_constraints_pin_what_is_required(file):
    lines = file.read_text().splitlines()
    pins = dict(line.split("==") for line in lines if not line.startswith("#"))
    pinned = {canonicalize_name(name): version for name, version in pins.items()}
    assert len(pinned) == len(lines) - 2
    for text in (*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["test"]):
        asked = Requirement(text)
        if asked.marker is None or asked.marker.evaluate({"python_version": file.stem}):
            assert pinned[canonicalize_name(asked.name)] in asked.specifier, text


def test_the_change_log_has_a_heading_for_each_version():
    """In the form of Keep a Changelog, the newest first, which is this one."""
    text = (ROOT / "CHANGELOG.md").read_text()
    first, *versions = re.findall(r"^## (.*)$", text, re.M)
    assert first == "Unreleased"
    parsed = [re.fullmatch(r"((\d+)\.(\d+)\.(\d+)) - (\d{4}-\d\d-\d\d)", version) for version in versions]
    assert all(parsed), versions
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert parsed[0].group(1, 5) == (neuro.__version__, str(citation["date-released"]))
    numbers = [tuple(map(int, match.group(2, 3, 4))) for match in parsed]
    assert numbers == sorted(set(numbers), reverse=True)
    kinds = set(re.findall(r"^### (.*)$", text, re.M))
    assert kinds <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_workflows_test_every_python_and_pin_what_they_use():
    """An action is pinned to a commit, since who owns it may move its tags."""
    files = {file.stem: file.read_text() for file in (ROOT / ".github" / "workflows").glob("*.yml")}
    told = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    jobs = yaml.safe_load(files["test"])["jobs"]
    assert jobs["test"]["strategy"]["matrix"]["python"] == told
    pythons = f'RELEASE_PYTHONS="{" ".join(f"python{python}" for python in told)}"'
    assert pythons in jobs["wheel"]["steps"][-1]["run"]
    assert pythons in files["release"]
    used = re.findall(r"uses: (.*)", "\n".join(files.values()))
    assert used
    assert [line for line in used if not re.fullmatch(r"[\w/-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", line)] == []


def test_no_link_of_the_readme_is_dead_on_the_index(tmp_path):
    for name in ("README.md", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    address = "https://host/me/neuro"
    subprocess.run([ROOT / ".ci" / "name-sources", address, "v1.2.3"], cwd=tmp_path, check=True)
    text = (tmp_path / "README.md").read_text()
    links = re.findall(r"\]\(([^)]*)\)", text)
    assert len(links) > 10
    assert [link for link in links if not link.startswith("https://")] == []
    assert f"]({address}/raw/v1.2.3/docs/how-to/watch_page.png)" in text
    assert f"]({address}/blob/v1.2.3/docs/tutorial.md)" in text
    assert tomllib.loads((tmp_path / "pyproject.toml").read_text())["project"]["urls"]["Source"] == address


def test_every_package_says_that_it_has_types():
    packages = {ROOT / "neuro", *(path.parent for path in ROOT.glob("*/neuro_*/*.py"))}
    assert len(packages) >= 13
    assert [package.name for package in packages if not (package / "py.typed").exists()] == []


def test_a_package_that_lacks_another_one_is_not_called_missing(monkeypatch, tmp_path):
    (tmp_path / "neuro_here").mkdir()
    (tmp_path / "neuro_here" / "playing.py").write_text("import neuro_needs_this")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="No module named 'neuro_needs_this'"):
        app("neuro_here.playing", "a camera")
    with pytest.raises(ModelError, match="a camera is in the package neuro_gone, which is not installed"):
        app("neuro_gone.playing", "a camera")
