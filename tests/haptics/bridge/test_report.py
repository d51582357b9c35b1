"""What is reported is short, however often it happens."""

from tensionlab.haptics.bridge.report import MAX_LINES, REPORT_S, LimitedReport


def test_the_same_line_is_said_once_in_a_while_and_counted():
    said, now = [], [0.0]
    report = LimitedReport(said.append, lambda: now[0])
    for _ in range(450):
        report("a")
        now[0] += REPORT_S / 450.5
    report("b")
    now[0] += 1.0
    report("a")
    assert said == ["a", "b", "449 more lines like these", "a"]
    report.finish()
    assert said[4:] == []


def test_lines_that_all_differ_are_said_up_to_a_number():
    said = []
    report = LimitedReport(said.append, lambda: 0.0)
    for number in range(1000):
        report(f"127.0.0.1, port {number}: commands")
    assert len(said) == MAX_LINES
    report.finish()
    assert said[-1] == f"{1000 - MAX_LINES} more lines like these"
