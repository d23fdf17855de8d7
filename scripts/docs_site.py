"""`make docs`: every page of the repository as a site with search, in the folder `site`. Broken links are errors.

python3 scripts/docs_site.py [FOLDER]
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from mkdocs.commands.build import build
from mkdocs.config import load_config

ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r'\]\(([^)#:\s]+)')
USE = (
    'commands job job_folder archive panel cells planning scanning registration real_cell robots laboratory twin '
    'recordings upgrading'
).split()
CHANGE = ('code_overview interfaces ros adding design equations adaptation link_protocol').split()


def tracked(*patterns: str) -> list[Path]:
    """Files that git knows, relative to the repository."""
    done = subprocess.run(
        ['git', '-C', ROOT, 'ls-files', *patterns], capture_output=True, text=True, check=True
    )
    return [Path(line) for line in done.stdout.splitlines()]


def gather(folder: Path) -> None:
    """All pages, and the files that they link to, at their places."""
    pages = tracked('*.md')
    linked = set(pages)
    for page in pages:
        for target in LINK.findall((ROOT / page).read_text()):
            path = (ROOT / page.parent / target).resolve()
            if path.is_file() and path.is_relative_to(ROOT):
                linked.add(path.relative_to(ROOT))
    for path in linked:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / path, folder / path)


def nav() -> list[dict]:
    """What stands in the menu."""
    packages = [
        {p.parts[2]: str(p)} for p in tracked('waam_ws/src/*/README.md') if len(p.parts) == 4
    ]
    log = [str(p) for p in tracked('docs/log/*.md')]
    return [
        {'Start': 'README.md'}, {'Where is what': 'docs/README.md'},
        {'Use': [f'docs/{name}.md' for name in USE]}, {'Change': [f'docs/{name}.md' for name in CHANGE]},
        {'Packages': packages}, {'Figures': ['docs/figures.md', 'docs/campaigns.md']}, {'Log': log},
        {'Changelog': 'CHANGELOG.md'},
    ]  # fmt: skip


def main(folder: Path) -> None:
    with tempfile.TemporaryDirectory() as source:
        gather(Path(source))
        config = str(ROOT / 'mkdocs.yml')
        found = load_config(config, docs_dir=source, site_dir=str(folder.resolve()), nav=nav())
        build(found)
    print(f'search needs a server: python3 -m http.server -b 127.0.0.1 -d {folder}')


if __name__ == '__main__':
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / 'site')
