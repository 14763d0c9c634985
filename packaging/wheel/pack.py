"""Packs the wheel: the public package, the extension's core modules that it needs, and the library.

Called by `cargo xtask wheel`, which builds the library and knows the platform's tag. The same input
gives the same bytes: files are sorted by name and all have the same date.
"""

import argparse
import ast
import base64
import hashlib
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "blender-addon/core"
PACKAGE = ROOT / "packaging/wheel/anyface"
LICENCES = ("LICENSE-MIT", "LICENSE-APACHE", "NOTICE", "THIRD-PARTY.md")
# The earliest date that a zip can hold.
DATE = (1980, 1, 1, 0, 0, 0)
EXECUTABLE, PLAIN = 0o100755 << 16, 0o100644 << 16


def core_of(package: Path, core: Path) -> list[Path]:
    """The modules of `core` that `package` imports, directly or through other modules of `core`."""
    waiting = [name for path in package.glob("*.py") for name in imported(path, "core")]
    modules: dict[str, Path] = {"__init__": core / "__init__.py"}
    while waiting:
        name = waiting.pop()
        if name not in modules:
            modules[name] = core / f"{name}.py"
            waiting += imported(modules[name], "")
    return [modules[name] for name in sorted(modules)]


def imported(path: Path, package: str) -> list[str]:
    """The modules of the relative `package` that a file imports; "" is the file's own package."""
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom) or not node.level:
            continue
        if node.level > 1:
            raise SystemExit(f"{path}: expected imports within its folder, line {node.lineno}")
        parent, _, last = (node.module or "").rpartition(".")
        if (node.module or "") == package:
            names += [alias.name for alias in node.names]
        elif parent == package:
            names.append(last)
    return names


def metadata(version: str) -> str:
    """The package's metadata for pip. Its description is the documentation page for users."""
    head = (ROOT / "packaging/wheel/METADATA.in").read_text(encoding="utf-8")
    page = (ROOT / "docs/python.md").read_text(encoding="utf-8")
    return head.replace("@VERSION@", version) + page


def contents(libraries: list[Path], version: str, tag: str) -> dict[str, bytes]:
    """The files of the wheel by name, without RECORD, which lists them."""
    files = {f"anyface/{path.name}": path for path in [*PACKAGE.glob("*.py"), PACKAGE / "py.typed"]}
    files |= {f"anyface/core/{path.name}": path for path in core_of(PACKAGE, CORE)}
    files |= {f"anyface/lib/{library.name}": library for library in libraries}
    info = f"anyface-{version}.dist-info"
    files |= {f"{info}/licenses/{name}": ROOT / name for name in LICENCES}
    packed = {name: path.read_bytes() for name, path in files.items()}
    wheel = f"Wheel-Version: 1.0\nGenerator: anyface\nRoot-Is-Purelib: false\nTag: py3-none-{tag}\n"
    packed[f"{info}/METADATA"] = metadata(version).encode()
    packed[f"{info}/WHEEL"] = wheel.encode()
    return packed


def record(files: dict[str, bytes], name: str) -> bytes:
    """The list of all files with their digests. Its own entry has no digest."""
    lines = []
    for path, content in sorted(files.items()):
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        lines.append(f"{path},sha256={digest},{len(content)}")
    return "\n".join([*lines, f"{name},,", ""]).encode()


def write(files: dict[str, bytes], path: Path) -> None:
    """Writes a zip with the best compression. An old file stays until the new one is complete."""
    partial = path.with_name(path.name + ".part")
    with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = EXECUTABLE if "/lib/" in name else PLAIN
            archive.writestr(entry, content)
    partial.replace(path)


def main() -> None:
    """Packs what the arguments name and prints the wheel's path."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--library", type=Path, nargs="+", required=True, help="the shared libraries")
    parser.add_argument("--version", required=True)
    parser.add_argument("--tag", required=True, help="such as manylinux_2_28_x86_64")
    parser.add_argument("--out", type=Path, required=True, help="the folder of the wheel")
    options = parser.parse_args()
    files = contents(options.library, options.version, options.tag)
    name = f"anyface-{options.version}.dist-info/RECORD"
    files = dict(sorted(files.items())) | {name: record(files, name)}
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / f"anyface-{options.version}-py3-none-{options.tag}.whl"
    write(files, path)
    print(path)


if __name__ == "__main__":
    main()
