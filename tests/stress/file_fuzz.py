"""Damaged files against all that reads files: ``python -m tests.stress.file_fuzz``, ``make file-fuzz``.

Every kind of file that the program reads is made as it should be, and then read with one to four mutations: of
what is in it, such as other types, huge numbers, keys that are missing, twice or unknown, nesting, control
characters, so that many come far behind the parser; or of its bytes. What is read is used as the program would use
it. Allowed are an answer and the house's own errors, as long as a message may be. Anything else is a finding:
other errors, warnings, a reading of more than `SLOWEST` seconds, more than `MEMORY` bytes. Each kind has a process
of its own, which the system stops where it takes too much.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType

from tensionlab.errors import MAX_MESSAGE_CHARACTERS, TensionlabError
from tests.stress.file_kinds import kinds

CASES = 100_000
SLOWEST = 10.0  # of a reading, in s of the processor
MEMORY = 4_000_000_000  # of a process with all its libraries, in bytes of address space
KEPT = 20  # findings that are told of each kind


@dataclass
class Tally:
    """What became of the cases of a kind of file.

    Attributes
    ----------
    read, refused : int
        Files that were read all the same; that were refused in words.
    findings : list of str
        What must not be: each with the number of its case.
    slowest : float
        Of all readings, in s of the processor.
    memory : int
        Most memory of the process, in bytes.
    """

    read: int = 0
    refused: int = 0
    findings: list[str] = field(default_factory=list)
    slowest: float = 0.0
    memory: int = 0


class TooSlow(BaseException):
    """A reading that takes too long."""


def fuzz(name: str, cases: Sequence[int], seed: int, folder: Path) -> Tally:
    """Read so many mutations of a kind of file, in this process.

    Parameters
    ----------
    name : str
        Of a kind, as in `kinds`.
    cases : sequence of int
        Their numbers: the same number and seed are the same file.
    seed : int
    folder : path
        To write files to.
    """
    tally, kind = Tally(), kinds(folder)[name]
    place = folder / f"case{kind.suffix}"
    kind.read(put(kind.encode(kind.document()), place))  # what is not damaged must be read
    for case in cases:
        rng = random.Random(f"{seed} {kind.name} {case}")
        put(kind.case(rng), place)
        begin = time.process_time()
        try:
            signal.setitimer(signal.ITIMER_PROF, SLOWEST)
            try:
                kind.read(place)
                tally.read += 1
            except TensionlabError as error:
                tally.refused += 1
                message = str(error).replace(str(folder), "")
                if len(message) > MAX_MESSAGE_CHARACTERS:
                    tally.findings.append(f"{case}: a message of {len(message)} characters: {message:.100}")
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
        except TooSlow:
            tally.findings.append(f"{case}: more than {SLOWEST:g} s")
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            told = f"{type(error).__name__}: {error!s:.100} ({Path(where.filename).name}:{where.lineno})"
            tally.findings.append(f"{case}: {told}")
        tally.slowest = max(tally.slowest, time.process_time() - begin)
    tally.memory = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return tally


def put(content: bytes | dict[str, bytes], place: Path) -> Path:
    """Write a file, or a folder of files."""
    if isinstance(content, bytes):
        place.write_bytes(content)
        return place
    for old in sorted(place.rglob("*"), reverse=True):
        old.rmdir() if old.is_dir() else old.unlink()
    for name, inner in content.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(inner)
    return place


def _stop(_: int, __: FrameType | None) -> None:
    raise TooSlow


def _child(name: str, cases: Sequence[int], seed: int, pipe: Connection) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGPROF, _stop)
    warnings.simplefilter("error")
    with tempfile.TemporaryDirectory() as folder:
        pipe.send(fuzz(name, cases, seed, Path(folder)))


def apart(name: str, cases: Sequence[int], seed: int) -> Tally:
    """Fuzz a kind in a process of its own, within bounds of memory; one that dies is a finding."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(name, cases, seed, there))
    process.start()
    there.close()
    try:
        tally: Tally = here.recv()
    except EOFError:
        tally = Tally()
        process.join()
        tally.findings.append(f"{cases[0]} to {cases[-1]}: the process ended with {process.exitcode}")
    process.join()
    return tally


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz all kinds, and tell what was found. Exit status 1 if there is a finding."""
    parser = argparse.ArgumentParser(description="Read damaged files of every kind.")
    parser.add_argument("--cases", type=int, default=CASES, help="files in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", help="only these kinds")
    asked = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        known = kinds(Path(folder))
    if unknown := set(asked.kind or ()) - known.keys():
        parser.error(f"no kind {min(unknown)!r}; there are {', '.join(known)}")
    chosen = [known[name] for name in asked.kind or known]
    weight = sum(kind.weight for kind in chosen)
    found = 0
    for kind in chosen:
        count = -(-asked.cases * kind.weight // weight)
        tally = apart(kind.name, range(count), asked.seed)
        print(
            f"{kind.name:22} {count:6} files: {tally.read:6} read, {tally.refused:6} refused, "
            f"{len(tally.findings)} findings; slowest {tally.slowest:.2f} s, {tally.memory / 1e6:.0f} MB",
            flush=True,
        )
        for finding, times in Counter(map(_cause, tally.findings)).most_common(KEPT):
            print(f"    {times} x {finding}; first: {next(each for each in tally.findings if finding in each)}")
        found += len(tally.findings)
    return 1 if found else 0


def _cause(finding: str) -> str:
    return finding.partition(": ")[2]


if __name__ == "__main__":
    sys.exit(main())
