"""Words of the program within a lesson, in the lesson's language."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LessonWords:
    """Words around what a lesson says itself. language: code as in HTML."""

    language: str
    place: str
    minutes: str
    knows: str
    begin: str
    go_on: str
    again: str
    next: str
    back: str
    finish: str
    skip: dict[str, str]
    computing: str
    missing: str
    run: str
    run_again: str
    restore: str
    leave: str
    lock_answer: str
    lock_line: str
    your_answer: str
    given: str
    prediction: str
    predicted: str
    equation: str
    equations: str
    right: str
    wrong: str
    what_happens: str
    number_right: str
    number_wrong: str
    line_right: str
    line_wrong: str
    figure: str
    measured: str
    controls: str
    anew: str
    reached: str
    not_yet: str
    wanted: dict[str, str]
    judged: str
    to_go: str
    changed_at: str
    stopped_before: str
    changed: str
    changed_run: str


ENGLISH = LessonWords(
    language="en",
    place="{} of {}",
    minutes="{} minutes.",
    knows="Afterwards you will know",
    begin="Begin",
    go_on="Continue at step {}",
    again="Take it again",
    next="Next",
    back="Back",
    finish="Finish",
    skip={
        "scenario": "Skip the scene",
        "predict": "Skip the prediction",
        "run": "Skip the run",
        "observe": "Skip the observation",
        "explain": "Skip the explanation",
        "goal": "Skip the goal",
    },
    computing="computing …",
    missing="The numbers that are missing are being computed.",
    run="Run: {} ({} s)",
    run_again="Run again: {} ({} s)",
    restore="Return to the lesson's scene",
    leave="Leave the lesson",
    lock_answer="Lock my answer",
    lock_line="Lock my line",
    your_answer="your answer",
    given="Your answer:",
    prediction="your prediction",
    predicted="predicted",
    equation="equation {} of the paper",
    equations="equations {} of the paper",
    right="right",
    wrong="not so",
    what_happens="what happens: {}",
    number_right="predicted {}, measured {}; it counts within {}",
    number_wrong="predicted {}, measured {}: off by {}",
    line_right="your line is off by {} (RMS)",
    line_wrong="your line is off by {} (RMS); it counts within {}",
    figure="Figure",
    measured="Measured",
    controls="Your controls",
    anew="Try it from the beginning",
    reached="reached",
    not_yet="not yet",
    wanted={"above": "wanted: above", "below": "wanted: below"},
    judged="judged at t = {} s of a run from the beginning, without a change on the way",
    to_go="It is {}: another {} s to go.",
    changed_at="Changed at t = {} s: try it again. It is {}.",
    stopped_before="The run has stopped before t = {} s: try it again.",
    changed="You changed something since: try it again.",
    changed_run="You changed this run while it went on: the picture shows it as the lesson describes it.",
)
GERMAN = LessonWords(
    language="de",
    place="{} von {}",
    minutes="{} Minuten.",
    knows="Danach ist klar,",
    begin="Beginnen",
    go_on="Weiter bei Schritt {}",
    again="Noch einmal von vorn",
    next="Weiter",
    back="Zurück",
    finish="Beenden",
    skip={
        "scenario": "Szene überspringen",
        "predict": "Vorhersage überspringen",
        "run": "Lauf überspringen",
        "observe": "Beobachtung überspringen",
        "explain": "Erklärung überspringen",
        "goal": "Ziel überspringen",
    },
    computing="wird berechnet …",
    missing="Die fehlenden Zahlen werden berechnet.",
    run="Lauf: {} ({} s)",
    run_again="Lauf wiederholen: {} ({} s)",
    restore="Zur Szene der Lektion zurück",
    leave="Lektion verlassen",
    lock_answer="Antwort festlegen",
    lock_line="Linie festlegen",
    your_answer="Antwort",
    given="Gegebene Antwort:",
    prediction="Vorhersage",
    predicted="vorhergesagt",
    equation="Gleichung {} der Veröffentlichung",
    equations="Gleichungen {} der Veröffentlichung",
    right="richtig",
    wrong="nicht ganz",
    what_happens="was geschieht: {}",
    number_right="vorhergesagt {}, gemessen {}; es zählt bis auf {}",
    number_wrong="vorhergesagt {}, gemessen {}: {} daneben",
    line_right="die Linie liegt um {} daneben (quadratisches Mittel)",
    line_wrong="die Linie liegt um {} daneben (quadratisches Mittel); sie zählt bis {}",
    figure="Bild",
    measured="Gemessen",
    controls="Regler",
    anew="Von vorn versuchen",
    reached="erreicht",
    not_yet="noch nicht",
    wanted={"above": "verlangt: über", "below": "verlangt: unter"},
    judged="bei t = {} s beurteilt, in einem Lauf von Anfang an, ohne Änderung auf dem Weg",
    to_go="Das Ziel wird {}: noch {} s.",
    changed_at="Bei t = {} s geändert: noch einmal versuchen. Das Ziel wird {}.",
    stopped_before="Der Lauf hat vor t = {} s aufgehört: noch einmal versuchen.",
    changed="Seither wurde etwas geändert: noch einmal versuchen.",
    changed_run="Dieser Lauf wurde währenddessen geändert: das Bild zeigt ihn, wie ihn die Lektion beschreibt.",
)
_BY_LANGUAGE = {words.language: words for words in (ENGLISH, GERMAN)}


def words_of(language: str) -> LessonWords:
    """Words in a language, English for one that the program does not speak."""
    return _BY_LANGUAGE.get(language, ENGLISH)
