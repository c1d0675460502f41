"""Generated pages of the site, and links that leave it.

The catalogue and the reference of the Structured Text are made from their sources. Links that leave the documentation
lead to the sources, and must point at something that is there. The one script that the theme would load from elsewhere,
by which pages in a folder can be searched, is taken along.
"""

import importlib.util
import json
import re
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

SHIM = re.compile(r"https://[^\"']*/iframe-worker/shim")
PICTURES = {"plc/example/faceplate.svg": "faceplate.svg"}
"""Drawings from outside of the documentation, and what they are called in the site."""
CELL = re.compile(r"<td\b.*?</td>", re.DOTALL)
NAME = re.compile(r"(?<=<code>)[\w.]{24,}(?=</code>)")
"""A long name with dots in a cell of a table: where it may be broken is said, or it makes the table too wide."""
LINK = re.compile(r"(?<=\]\()([^)#:\s]+)(#[^)\s]*)?(?=\))")


def on_config(config: Any) -> Any:
    """Take the place of the sources from where it stands once."""
    project = tomllib.loads((Path(config.docs_dir).parent / "pyproject.toml").read_text())["project"]
    config.repo_url = project["urls"]["Source"] + "/"
    return config


def generated(root: Path) -> dict[str, str]:
    """Pages and drawings that stand in no file of the documentation: names and texts."""
    catalogue = json.loads((root / "vectors/catalogue.json").read_text(encoding="utf-8"))
    return {
        "catalogue.md": _module(root / "vectors/catalogue.py").page(catalogue),
        "plc-blocks.md": _module(root / "plc/package.py").reference(),
    } | {name: (root / path).read_text(encoding="utf-8") for path, name in PICTURES.items()}


def _module(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # its dataclasses ask for it
    spec.loader.exec_module(module)
    return module


def on_files(files: Any, *, config: Any) -> Any:
    """Add the pages that are generated."""
    from mkdocs.structure.files import File

    for name, text in generated(Path(config.docs_dir).parent).items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Any, config: Any, files: Any) -> str:
    """Rewrite what points out of the folder of the documentation.

    Raises FileNotFoundError if a link points nowhere.
    """
    docs = Path(config.docs_dir).resolve()
    here = docs / Path(page.file.src_uri).parent

    def led(link: re.Match[str]) -> str:
        to = (here / link[1]).resolve()
        if to.is_relative_to(docs) and not to.is_dir():
            return link[0]  # the site's own check has it
        if name := PICTURES.get(to.relative_to(docs.parent).as_posix()):
            return name
        if not to.exists():
            raise FileNotFoundError(f"{page.file.src_uri}: the link {link[0]} leads nowhere")
        kind = "tree" if to.is_dir() else "blob"
        return f"{config.repo_url}{kind}/main/{to.relative_to(docs.parent)}{link[2] or ''}"

    # For the colours `st` is Smalltalk; comments, literals and blocks are those of Pascal.
    return LINK.sub(led, markdown).replace("```st\n", "```pascal\n")


def on_post_page(output: str, *, page: Any, config: Any) -> str:
    """Take the script from the site itself, and finish the text.

    Long names in tables break after a dot, and the two colons before a drawing in a docstring are one.
    """
    up = "../" * page.url.count("/")
    return broken_after_dots(SHIM.sub(f"{up}assets/shim.js", output).replace("::</p>", ":</p>"))


def broken_after_dots(output: str) -> str:
    """A page whose long names in tables may be broken after a dot.

    >>> broken_after_dots("<td><code>modules.BacklashDetection.tf</code></td>")
    '<td><code>modules.<wbr>BacklashDetection.<wbr>tf</code></td>'
    """
    return CELL.sub(lambda cell: NAME.sub(lambda name: name[0].replace(".", ".<wbr>"), cell[0]), output)


def on_post_build(*, config: Any) -> None:
    """Put that script into the site, and take out what only a server shows."""
    found = Path(config.docs_dir).parent / "target/site/node_modules/iframe-worker/shim/index.js"
    shutil.copyfile(found, Path(config.site_dir) / "assets/shim.js")
    (Path(config.site_dir) / "404.html").unlink()
