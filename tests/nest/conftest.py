"""What the random networks came to, in one line at the end."""

from collections import Counter


def pytest_terminal_summary(terminalreporter):
    found = Counter()
    for report in terminalreporter.getreports("passed"):
        found.update(dict(report.user_properties).get("random networks", {}))
    if found:
        told = ", ".join(f"{count:,} {what}" for what, count in found.items())
        terminalreporter.section("random networks")
        terminalreporter.line(f"on event, reference and NEST: {told}; nothing unexplained in what passed")
