"""The pictures of how the methods work: they are made of what the code computes, and lie where documents show them."""

import numpy as np
import pytest

from tests import pictures


@pytest.mark.parametrize("name", ["steps", "rays", "fusion", "axes"])
def test_a_picture_is_made_where_documents_show_it(name: str) -> None:
    made = pictures.MAKERS[name]()
    documents = [path.read_text() for path in pictures.DOCS.glob("*.md")]
    for path in made:
        assert (pictures.DOCS / path).exists()
        assert any(f"]({path})" in text for text in documents), path


def test_the_votes_that_are_drawn_fill_the_hole() -> None:
    drawn = pictures.votes_of_hole()
    assert len(drawn.votes) == 5
    assert pictures.elected_px(drawn.votes) == pytest.approx(drawn.filled_px, abs=0.3)
    wins = [pictures.is_one_surface(vote.disparity_px, drawn.filled_px) for vote in drawn.votes]
    assert np.count_nonzero(wins) == 3
