"""Prints random sentences of the project for a reader to judge: `python tests/sample_sentences.py [KIND] [--seed N]`.

Kinds: docs, messages, comments, docstrings, tests (their names). Nothing judges but the reader, who counts the
sentences that had to be read twice. The same seed gives the same sentences as long as the text stays.
"""

from __future__ import annotations

import argparse
import ast
import io
import random
import re
import subprocess
import tokenize
from collections.abc import Callable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
SENTENCE_END = re.compile(r"(?<=[.!?:])\s+(?=[A-Z`\"*\[])")
C_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*(?:\n\s*//[^\n]*)*", re.DOTALL)
C_STRING = re.compile(r'"((?:[^"\\\n]|\\.)*)"')
SHORTEST_WORDS = 5  # shorter ones are names or fragments

Found = Iterator[tuple[str, str]]


def tracked(*endings: str) -> list[Path]:
    names = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    return [ROOT / name for name in names if name.endswith(endings) and not (ROOT / name).is_symlink()]


def is_test(path: Path) -> bool:
    return path.relative_to(ROOT).parts[0] == "tests"


def sentences_of(text: str) -> list[str]:
    sentences = SENTENCE_END.split(" ".join(text.split()))
    return [sentence for sentence in sentences if len(sentence.split()) >= SHORTEST_WORDS]


def docs() -> Found:
    """Paragraphs and cells of tables; blocks of code are left out."""
    for path in tracked(".md"):
        text = re.sub(r"^```.*?^```$|^    [^\n]*$", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)
        blocks = re.split(r"\n\s*\n|\n(?=[-*#|]|\d+\.)| \| ", text)
        yield from ((str(path), sentence) for block in blocks for sentence in sentences_of(block.strip("-*#| \n")))


def docstrings_of(tree: ast.Module) -> list[ast.Constant]:
    """The first expression of each module, class and function, where it is a text."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    bodies = [node.body for node in ast.walk(tree) if isinstance(node, kinds)]
    first = [body[0].value for body in bodies if body and isinstance(body[0], ast.Expr)]
    return [value for value in first if isinstance(value, ast.Constant) and isinstance(value.value, str)]


def docstrings() -> Found:
    for path in tracked(".py"):
        for text in docstrings_of(ast.parse(path.read_text())):
            yield from ((str(path), sentence) for sentence in sentences_of(str(text.value)))


def messages() -> Found:
    """Texts of the product that are no docstrings: errors, reasons, help."""
    for path in tracked(".py"):
        if is_test(path):
            continue
        tree = ast.parse(path.read_text())
        described = {id(text) for text in docstrings_of(tree)}
        formatted = [node for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)]
        parts = {id(part) for node in formatted for part in node.values}
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                yield from ((str(path), sentence) for sentence in sentences_of(ast.unparse(node)[2:-1]))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in described | parts:
                yield from ((str(path), sentence) for sentence in sentences_of(node.value))
    for path in tracked(".c", ".h"):
        if not is_test(path):
            texts = C_STRING.findall(C_COMMENT.sub("", path.read_text()))
            yield from ((str(path), sentence) for text in texts for sentence in sentences_of(text))


def comments() -> Found:
    """Whole lines of comment in a row are one text; a comment behind code stands alone."""
    for path in tracked(".py"):
        lines: list[tuple[int, str, bool]] = []
        for token in tokenize.generate_tokens(io.StringIO(path.read_text()).readline):
            if token.type == tokenize.COMMENT:
                lines.append((token.start[0], token.string.lstrip("#! "), token.line.lstrip().startswith("#")))
        texts: list[str] = []
        before = (-1, "", False)
        for number, line, is_whole in lines:
            if is_whole and before[2] and before[0] == number - 1:
                texts[-1] += " " + line
            else:
                texts.append(line)
            before = (number, line, is_whole)
        yield from ((str(path), sentence) for text in texts for sentence in sentences_of(text))
    for path in tracked(".c", ".h"):
        for text in C_COMMENT.findall(path.read_text()):
            plain = re.sub(r"^\s*(?:/?\*+|//)|\*/", "", text, flags=re.MULTILINE)
            yield from ((str(path), sentence) for sentence in sentences_of(plain))


def tests() -> Found:
    for path in tracked(".py", ".c"):
        if is_test(path):
            yield from (
                (str(path), name) for name in re.findall(r"^\s*(?:def|void) (test_\w+)", path.read_text(), re.M)
            )


KINDS: dict[str, Callable[[], Found]] = {kind.__name__: kind for kind in (docs, messages, comments, docstrings, tests)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"{', '.join(KINDS)}; without one: all of them")
    parser.add_argument("--count", type=int, default=50, help="sentences of each kind")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if unknown := [kind for kind in options.kinds if kind not in KINDS]:
        parser.error(f"{unknown[0]}: no such kind. There are {', '.join(KINDS)}.")
    for kind in options.kinds or KINDS:
        found = sorted(set(KINDS[kind]()))
        print(f"\n{kind}: {min(options.count, len(found))} of {len(found)}\n")
        for path, sentence in random.Random(options.seed).sample(found, min(options.count, len(found))):
            print(f"{Path(path).relative_to(ROOT)}: {sentence}")


if __name__ == "__main__":
    main()
