"""Run with python -m pytest. Then put your recordings in place of shapes.zip, and state what must stay true."""

from learn import accuracy, halves, trained

from neuro_recognise import Recogniser


def test_it_recognises_shapes_that_it_has_not_seen():
    learning, unseen = halves()
    assert accuracy(trained(learning), unseen) > 0.6


def test_a_file_of_it_decides_alike(tmp_path):
    learning, unseen = halves()
    recogniser = trained(learning, tmp_path / "model.h5")
    assert (Recogniser.load(tmp_path / "model.h5").predict(unseen) == recogniser.predict(unseen)).all()
