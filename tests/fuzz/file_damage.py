"""What happens to files: letters, lines and values that are others, missing, or there twice."""

import re

import numpy as np

ODD = (
    *(".nan", "-.inf", "1e400", "-1e400", "1e-400", "9" * 400, "-" + "9" * 5000, "0x" + "f" * 300, "0o17", "0b1"),
    *("2020-13-45", "2020-01-01T25:61:61Z", "12:30:45.5", "yes", "no", "true", "~", "null", "", "''", "=", "<<", "!"),
    *("[[[[1]]]]", "{a: {b: {c: 1}}}", "[]", "{}", "[1, [2, 3]]", "*a", "&a [*a]", "&a [1]", "*b0", "<<: *a", "? x"),
    *("!!int abc", "!!float x", "!!binary aGk=", "!!set {a}", "!!omap [a: 1]", "!!timestamp x", "!Nonsense {}"),
    *("!!python/object/apply:os.system [touch pwned]", "!!python/name:os.system", "!<tag:yaml.org,2002:int> 1"),
    *("\u00fc\u4e16\u754c", "\u202eevil", '"\\x1b[31m"', '"a\\0b"', "a\x07b", "\ud7ff", "|\n  two\n  lines", ">-\n  x"),
    *("[/x]", "{{x}}", "%s%n", "../../../etc/passwd", "/dev/zero", "h" * 300, "x" * 5000, "- " * 60, "[" * 3000),
    *("0", "-0.0", "-1", "1", "2", "1.5", "1e-300", "1e300", "1000000000", "100000000000000000000", "4294967296"),
)


def damage(text: str, rng: np.random.Generator) -> bytes:
    """A text with a damage or a few."""
    for _ in range(rng.geometric(0.6)):
        text = _DAMAGES[rng.integers(len(_DAMAGES))](text, rng)
    content = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.1:
        content = damage_bytes(content, rng)
    if rng.random() < 0.03:
        encoding = ("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "utf-7", "cp037")[rng.integers(6)]
        content = text.encode(encoding, "replace")
    return content


def damage_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes of which some are others, are missing, are there twice, or are in another order."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        if not data:
            break
        start, end = sorted(rng.integers(len(data) + 1, size=2).tolist())
        match rng.integers(6):
            case 0:
                for i in rng.integers(len(data), size=rng.integers(1, 9)):
                    data[i] ^= 1 << int(rng.integers(8))
            case 1:
                del data[end:]
            case 2:
                del data[start : start + int(rng.integers(1, 40))]
            case 3:
                data[start:start] = data[start : min(end, start + 2000)]
            case 4:
                width = min(8, len(data) - start)
                filler = (b"\x00", b"\xff", b"\x7f", b"\x80")[rng.integers(4)]
                data[start : start + width] = filler * width
            case _:
                data[start:start] = rng.bytes(int(rng.integers(1, 30)))
    return bytes(data)


def _swap_lines(text: str, rng: np.random.Generator) -> str:
    lines = text.split("\n")
    first, second = rng.integers(len(lines), size=2)
    lines[first], lines[second] = lines[second], lines[first]
    return "\n".join(lines)


def _repeat_line(text: str, rng: np.random.Generator) -> str:
    lines = text.split("\n")
    line = lines[rng.integers(len(lines))]
    lines[(at := rng.integers(len(lines))) : at] = [line] * int(rng.choice([1, 2, 50]))
    return "\n".join(lines)


def _drop_line(text: str, rng: np.random.Generator) -> str:
    lines = text.split("\n")
    del lines[rng.integers(len(lines))]
    return "\n".join(lines)


def _truncate(text: str, rng: np.random.Generator) -> str:
    return text[: rng.integers(len(text) + 1)]


def _replace_value(text: str, rng: np.random.Generator) -> str:
    """One word, number or name, wherever it stands, becomes an odd one."""
    words = list(re.finditer(r"[\w.+-]+", text))
    if not words:
        return text
    word = words[rng.integers(len(words))]
    return text[: word.start()] + _odd(rng) + text[word.end() :]


def _replace_number(text: str, rng: np.random.Generator) -> str:
    """One number becomes another, or that of another place."""
    found = list(re.finditer(r"(?<![\w.])-?[0-9][0-9.e+-]*(?!\w)", text))
    if not found:
        return text
    old, other = (found[i] for i in rng.integers(len(found), size=2))
    new = rng.choice([other.group(), f"-{old.group()}", f"{old.group()}0000", *ODD[-11:]])
    return text[: old.start()] + new + text[old.end() :]


def _replace_rest_of_line(text: str, rng: np.random.Generator) -> str:
    colons = [i for i, letter in enumerate(text) if letter == ":"]
    if not colons:
        return text
    start = colons[rng.integers(len(colons))] + 1
    end = text.find("\n", start)
    return f"{text[:start]} {_odd(rng)}{text[end if end >= 0 else len(text) :]}"


def _insert(text: str, rng: np.random.Generator) -> str:
    at = rng.integers(len(text) + 1)
    return text[:at] + _odd(rng) + text[at:]


def _insert_letter(text: str, rng: np.random.Generator) -> str:
    at = rng.integers(len(text) + 1)
    letters = "{}[]:,-?!&*#|>'\"%@`~= \t\n\r\x00\x85\u2028\ufeff"
    return text[:at] + letters[rng.integers(len(letters))] + text[at:]


def _laugh(text: str, rng: np.random.Generator) -> str:
    """References to references, in front."""
    count, width = int(rng.integers(2, 12)), int(rng.integers(2, 12))
    lines = ["_b0: &b0 [0, 1]"] + [f"_b{i}: &b{i} [{', '.join([f'*b{i - 1}'] * width)}]" for i in range(1, count)]
    return "\n".join(lines) + "\n" + text


_DAMAGES = (
    *(_swap_lines, _repeat_line, _drop_line, _truncate, _insert, _insert_letter, _laugh),
    *(_replace_value, _replace_value, _replace_number, _replace_number, _replace_rest_of_line, _replace_rest_of_line),
)


def _odd(rng: np.random.Generator) -> str:
    return ODD[rng.integers(len(ODD))]
