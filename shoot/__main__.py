"""`python -m shoot`: which commands there are; nothing is loaded for it but this file."""

import ast
from pathlib import Path


def list_commands() -> list[tuple[str, str]]:
    """(command, what it does) of each file in `cli/` that is one; its first line says both."""
    found = []
    for path in sorted((Path(__file__).parent / "cli").glob("*.py")):
        words = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        command, _, does = words.partition(": ")
        if command.startswith("shoot-"):
            found.append((command, does.splitlines()[0]))
    return found


def main() -> None:
    """Print them."""
    print("The commands of shoot; each says more with --help:\n")
    for command, does in list_commands():
        print(f"  {command:<22}{does}")


if __name__ == "__main__":
    main()
