"""Adds the tests that take long to tests/slow.txt. python tests/robustness/slow_tests.py (`make slow`).

The time of a test is what the processor needs for all its cases, with the processes that they start and with what is
made once for this test and others: fixtures of a file or of the session. What is listed is not run: without its line, a
test is measured anew.
"""

import os
import sys
from collections import Counter, defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LIST = ROOT / "tests" / "slow.txt"
LIMIT = 0.25
"""Seconds."""


def spent():
    """Seconds of the processor, for this process and those that it has waited for."""
    return sum(os.times()[:4])


class Measured:
    """Adds up the seconds of tests and of the fixtures that are made once for several."""

    def __init__(self):
        self.tests, self.shared, self.users = Counter(), Counter(), defaultdict(set)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item):
        name = item.nodeid.partition("[")[0]
        for fixture in item.fixturenames:
            self.users[fixture].add(name)
        shared_before, before = self.shared.total(), spent()
        try:
            return (yield)
        finally:
            self.tests[name] += spent() - before - (self.shared.total() - shared_before)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_fixture_setup(self, fixturedef):
        before = spent()
        try:
            return (yield)
        finally:
            if fixturedef.scope != "function":
                self.shared[fixturedef.argname, fixturedef.baseid] += spent() - before

    def slow(self):
        """Names of the tests that take longer than the limit."""
        total = Counter(self.tests)
        for (fixture, where), seconds in self.shared.items():
            for name in self.users[fixture]:
                total[name] += seconds * name.startswith(where)
        return {name for name, seconds in total.items() if seconds > LIMIT}


def main():
    """Measure the tests that are not listed; the exit code of the tests."""
    measured = Measured()
    code = pytest.main(["-m", "not slow", str(ROOT / "tests")], plugins=[measured])
    if code == pytest.ExitCode.OK:
        listed, found = set(LIST.read_text(encoding="utf-8").split()), measured.slow()
        LIST.write_text("".join(f"{name}\n" for name in sorted(listed | found)), encoding="utf-8")
        print(*sorted(found - listed), sep="\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
