"""A key that floods is held to its allowance; its neighbours are not."""

from edge.link.reception import QUESTIONS_BURST, QUESTIONS_HZ, Reception


def test_questions_of_all_together_have_an_allowance() -> None:
    reception = Reception()
    answered = sum(reception.admit_question() for _ in range(5000))
    assert QUESTIONS_BURST <= answered < QUESTIONS_BURST + 2 * QUESTIONS_HZ
    assert reception.counters.unanswered == 5000 - answered
