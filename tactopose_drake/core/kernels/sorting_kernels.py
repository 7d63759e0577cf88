"""Sorting, selecting and copying, compiled once; NumPy's own are compiled anew for each kernel that uses them."""

from tactopose_drake.core.compilation import part
from tactopose_drake.core.kernel_types import Floats1, Floats2, OutFloats1, OutFloats2, OutLongs1, OutSingles1


@part
def sort_stably(values: Floats1, order: OutLongs1, spare: OutLongs1) -> None:
    """The order (n,) that sorts values (n,), ascending and stably; none may be NaN. spare (n,) is scratch."""
    n = values.shape[0]
    for i in range(n):
        order[i] = i
    width = 1
    while width < n:
        begin = 0
        while begin < n:
            middle = begin + width if begin + width < n else n
            end = middle + width if middle + width < n else n
            i, j = begin, middle
            for k in range(begin, end):
                if i < middle and (j >= end or not values[order[j]] < values[order[i]]):
                    spare[k] = order[i]
                    i += 1
                else:
                    spare[k] = order[j]
                    j += 1
            begin = end
        for i in range(n):
            order[i] = spare[i]
        width *= 2


@part
def select(values: OutSingles1, count: int, rank: int) -> float:
    """The value of the given rank among the first `count` values, none of them NaN; permutes these."""
    low, high = 0, count - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return values[rank]


@part
def copy_vector(source: Floats1, target: OutFloats1) -> None:
    """target[:] = source, both (n,)."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@part
def copy_matrix(source: Floats2, target: OutFloats2) -> None:
    """target[:] = source, both (n, m)."""
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[i, j] = source[i, j]
