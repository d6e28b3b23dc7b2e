"""Words of the program within a lesson, in the lesson's language."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LessonWords:
    """Words around what a lesson says itself.
    language: code as in HTML.
    decimal: mark before the decimals of a number.
    phases: of a run on the page, by name of the phase.
    failed, goes_on, locked, locked_but: of the strip over the scene, which also shows `refused` and `stopped`.
    ask_class to class_told: of the questions that a class is asked."""

    language: str
    decimal: str
    lesson: str
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
    phases: dict[str, str]
    refused: str
    stopped: str
    never: str
    restore: str
    restore_hint: str
    leave: str
    leave_hint: str
    key: str
    lock_answer: str
    lock_line: str
    lock_hint: str
    your_answer: str
    two_numbers: str
    no_number: str
    no_line: str
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
    figure_hint: str
    over_time: str
    as_predicted: str
    draw: str
    measured: str
    controls: str
    anew: str
    anew_hint: str
    reached: str
    not_yet: str
    wanted: dict[str, str]
    judged: str
    to_go: str
    changed_at: str
    stopped_before: str
    changed: str
    changed_run: str
    begun: str
    done: str
    goal_missed: str
    goals_missed: str
    answers_right: str
    deletes: str
    to_goal: str
    to_goal_hint: str
    failed: str
    goes_on: str
    locked: str
    locked_but: str
    ask_class: str
    ask_class_again: str
    ask_class_hint: str
    show_answers: str
    show_answers_hint: str
    answers: dict[str, str]
    answers_before: str
    between: str
    below: str
    above: str
    class_told: str

    def number(self, text: str) -> str:
        """Number that is written with a point, with the decimal mark of the language."""
        return text.replace(".", self.decimal)

    def counted(self, answers: int) -> str:
        """Number of answers in words."""
        return self.answers["one" if answers == 1 else "many"].format(answers)

    def of_run(self, title: str, seconds: float, *, again: bool) -> str:
        """Label of the button that plays a run."""
        return (self.run_again if again else self.run).format(title, self.number(f"{seconds:g}"))


ENGLISH = LessonWords(
    language="en",
    decimal=".",
    lesson="Lesson",
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
    phases={"running": "running …", "paused": "paused …", "stopped": "stopped …"},
    refused="Refused: {}",
    stopped="Stopped: {}",
    never="not within the run",
    restore="Return to the lesson's scene",
    restore_hint="Loads the step's scenario again.",
    leave="Leave the lesson",
    leave_hint="Next time it continues from here.",
    key="Key: {}",
    lock_answer="Lock my answer",
    lock_line="Lock my line",
    lock_hint="It counts once, before the run.",
    your_answer="your answer",
    two_numbers="your answer: {} can be read in two ways; allowed: {} or {}",
    no_number="your answer: {}; allowed: a number, such as 12.5",
    no_line="your line: nothing is drawn yet; allowed: draw it on the axes, or use the arrow keys",
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
    figure_hint="Saves this picture on white.",
    over_time="{} over time",
    as_predicted="{}, as predicted",
    draw="{}: draw with the mouse, or choose an instant with ← →, and its value with ↑ ↓",
    measured="Measured",
    controls="Your controls",
    anew="Try it from the beginning",
    anew_hint="What happens at the beginning, such as a push, happens again.",
    reached="reached",
    not_yet="not yet",
    wanted={"above": "wanted: above", "below": "wanted: below"},
    judged="judged at t = {} s of a run from the beginning, without a change on the way",
    to_go="It is {}: another {} s to go.",
    changed_at="Changed at t = {} s: try it again. It is {}.",
    stopped_before="The run has stopped before t = {} s: try it again.",
    changed="You changed something since: try it again.",
    changed_run="You changed this run while it went on: the picture shows it as the lesson describes it.",
    begun="begun",
    done="done",
    goal_missed="done, goal not met",
    goals_missed="done, {} of {} goals not met",
    answers_right="{} of {} answers right",
    deletes="Taking it again deletes your answers. Save them first if you want to keep them.",
    to_goal="Back to the goal",
    to_goal_hint="The last step once more; the answers stay.",
    failed="Failed: {}",
    goes_on="An edit or Reset (R) begins a new run; the timeline looks back.",
    locked="{}: locked by the goal of a lesson; allowed: leave the lesson",
    locked_but="{}: locked by the goal of a lesson; allowed: {}, or leave the lesson",
    ask_class="Ask the class",
    ask_class_again="Ask again",
    ask_class_hint="By the link and the QR code of “Share”.",
    show_answers="Show the answers",
    show_answers_hint="Takes no more answers.",
    answers={"one": "{} answer", "many": "{} answers"},
    answers_before="{} when it was asked last",
    between="{} to {} {}",
    below="below {} {}",
    above="above {} {}",
    class_told="{}; watch the screen",
)
GERMAN = LessonWords(
    language="de",
    decimal=",",
    lesson="Lektion",
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
    phases={"running": "läuft …", "paused": "angehalten …", "stopped": "abgebrochen …"},
    refused="Abgelehnt: {}",
    stopped="Abgebrochen: {}",
    never="nicht während des Laufs",
    restore="Zur Szene der Lektion zurück",
    restore_hint="Lädt das Szenario des Schritts noch einmal.",
    leave="Lektion verlassen",
    leave_hint="Das nächste Mal geht es hier weiter.",
    key="Taste: {}",
    lock_answer="Antwort festlegen",
    lock_line="Linie festlegen",
    lock_hint="Sie zählt einmal, vor dem Lauf.",
    your_answer="Antwort",
    two_numbers="Antwort: {} ist auf zwei Arten lesbar; erlaubt: {} oder {}",
    no_number="Antwort: {}; erlaubt: eine Zahl wie 12,5",
    no_line="Linie: noch nichts gezeichnet; erlaubt: auf den Achsen zeichnen oder die Pfeiltasten benutzen",
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
    figure_hint="Speichert dieses Bild auf Weiß.",
    over_time="{} über der Zeit",
    as_predicted="{}, wie vorhergesagt",
    draw="{}: mit der Maus zeichnen, oder mit ← → einen Zeitpunkt wählen und mit ↑ ↓ seinen Wert",
    measured="Gemessen",
    controls="Regler",
    anew="Von vorn versuchen",
    anew_hint="Was am Anfang geschieht, etwa ein Stoß, geschieht noch einmal.",
    reached="erreicht",
    not_yet="noch nicht",
    wanted={"above": "verlangt: über", "below": "verlangt: unter"},
    judged="bei t = {} s beurteilt, in einem Lauf von Anfang an, ohne Änderung auf dem Weg",
    to_go="Das Ziel wird {}: noch {} s.",
    changed_at="Bei t = {} s geändert: noch einmal versuchen. Das Ziel wird {}.",
    stopped_before="Der Lauf hat vor t = {} s aufgehört: noch einmal versuchen.",
    changed="Seither wurde etwas geändert: noch einmal versuchen.",
    changed_run="Dieser Lauf wurde währenddessen geändert: das Bild zeigt ihn, wie ihn die Lektion beschreibt.",
    begun="begonnen",
    done="fertig",
    goal_missed="fertig, Ziel nicht erreicht",
    goals_missed="fertig, {} von {} Zielen nicht erreicht",
    answers_right="{} von {} Antworten richtig",
    deletes="Noch einmal von vorn löscht die Antworten. Wer sie behalten will, speichert sie vorher.",
    to_goal="Zurück zum Ziel",
    to_goal_hint="Noch einmal der letzte Schritt; die Antworten bleiben.",
    failed="Fehlgeschlagen: {}",
    goes_on="Eine Änderung oder Reset (R) beginnt einen neuen Lauf; die Zeitleiste blickt zurück.",
    locked="{}: gesperrt durch das Ziel der Lektion; erlaubt: die Lektion verlassen",
    locked_but="{}: gesperrt durch das Ziel der Lektion; erlaubt: {}, oder die Lektion verlassen",
    ask_class="Die Klasse fragen",
    ask_class_again="Noch einmal fragen",
    ask_class_hint="Über Link und QR-Code von „Share“.",
    show_answers="Antworten zeigen",
    show_answers_hint="Dann zählt keine weitere Antwort.",
    answers={"one": "{} Antwort", "many": "{} Antworten"},
    answers_before="{}, als zuletzt gefragt wurde",
    between="{} bis {} {}",
    below="unter {} {}",
    above="über {} {}",
    class_told="{}; bitte nach vorn schauen",
)
_BY_LANGUAGE = {words.language: words for words in (ENGLISH, GERMAN)}


def words_of(language: str) -> LessonWords:
    """Words in a language, English for one that the program does not speak."""
    return _BY_LANGUAGE.get(language, ENGLISH)
