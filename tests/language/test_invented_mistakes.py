"""What stands in for a broken part decides nothing: no mistake is made up for it, and none beside it is lost."""

from beside import beside
from golden_messages import read
from rewording import same_if_reworded

(POPULATIONS,) = beside(__file__, "POPULATIONS")


def test_nothing_is_invented(folder, all_mistakes, messages):
    messages.of(lambda text: all_mistakes(POPULATIONS + text))


def test_no_program_reads_the_messages(folder):
    for text in read()["language/test_invented_mistakes.py::test_nothing_is_invented"]:
        same_if_reworded(POPULATIONS + text)
