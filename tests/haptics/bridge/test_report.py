"""What is reported is short, however often it happens."""

from tensionlab.haptics.bridge.report import MAX_LINES, MAX_REASONS, REPORT_S, LimitedReport


def test_the_same_line_is_said_once_in_a_while_and_counted():
    said, now = [], [0.0]
    report = LimitedReport(said.append, lambda: now[0])
    for _ in range(450):
        report("a")
        now[0] += REPORT_S / 450.5
    report("b")
    now[0] += 1.0
    report("a")
    assert said == ["a", "b", "449 more times: a", "a"]
    report.finish()
    assert said[4:] == []


def test_lines_that_all_differ_are_said_up_to_a_number():
    said = []
    report = LimitedReport(said.append, lambda: 0.0)
    for number in range(1000):
        report(f"127.0.0.1, port {number}: commands")
    assert len(said) == MAX_LINES
    report.finish()
    assert said[-1] == f"{1000 - MAX_LINES} more times: commands"


def test_reasons_are_counted_each_for_itself():
    said = []
    report = LimitedReport(said.append, lambda: 0.0)
    for line in ("a: late", "b: late", *3 * ["a: early"], "a: late"):
        report(line)
    report.finish()
    assert said == ["a: late", "b: late", "a: early", "2 more times: early", "once more: late"]


def test_of_too_many_reasons_the_most_frequent_are_named():
    said = []
    report = LimitedReport(said.append, lambda: 0.0)
    for number in range(100):
        report(f"a: {number}")
    report.finish()
    assert len(said) == MAX_LINES + MAX_REASONS + 1
    assert said[-1] == f"{100 - MAX_LINES - MAX_REASONS} more times: something else"
