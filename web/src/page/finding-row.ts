// A finding in the list: its name, what is written about it, and how it is shown. It stays as long as the finding does.

import { h, iconButton, quiet, setText, setValue, tell } from "../base/dom.ts";
import { gyrusWords, number, t } from "../base/i18n.ts";
import { positionWords } from "../base/readout.ts";
import type { ReadyCase } from "../model/case.ts";
import { CERTAINTIES, type Certainty, type Finding, LONGEST_LABEL, LONGEST_NOTE, middleOf } from "../model/findings.ts";
import { mirrorPlane, sideOf } from "../model/midsagittal.ts";
import { excessOf, plainLine, plainText } from "../model/text.ts";
import { button, choice, line, row, tall, ticked } from "./fields.ts";

export interface FindingRowListener {
  /** The finding is gone to. */
  go(finding: Finding): void;
  remove(): void;
  /** Text as it is typed. */
  write(text: Partial<Pick<Finding, "label" | "note">>): void;
  /** The field is left. */
  written(): void;
  change(change: Partial<Pick<Finding, "colour" | "is_dismissed">>): void;
  certain(certainty: Certainty | null): void;
  /** Whether it is drawn in the panes. */
  draw(isDrawn: boolean): void;
}

const plainLabel = (text: string): string => plainLine(text, LONGEST_LABEL);
const plainNote = (text: string): string => plainText(text, LONGEST_NOTE);

export class FindingRow {
  readonly element: HTMLLIElement;
  readonly #shown: ReadyCase;
  #finding: Finding;
  readonly #go: HTMLButtonElement;
  readonly #remove: HTMLButtonElement;
  readonly #label: HTMLInputElement;
  readonly #note: HTMLTextAreaElement;
  /** That the note is longer than what is kept. */
  readonly #excess = h("p", { class: "doubtful", role: "status", hidden: true });
  readonly #certainty: HTMLSelectElement;
  readonly #colour: HTMLInputElement;
  readonly #dismissed: HTMLInputElement;
  readonly #where = quiet("");

  constructor(finding: Finding, shown: ReadyCase, isDrawn: boolean, listener: FindingRowListener) {
    this.#finding = finding;
    this.#shown = shown;
    this.#go = button("", () => listener.go(this.#finding), { class: "finding-name" });
    this.#remove = iconButton("trash", "", () => listener.remove());
    this.#label = h("input", {
      type: "text",
      class: "finding-label",
      maxlength: LONGEST_LABEL,
      dir: "auto",
      placeholder: t("findings.label"),
      input: () => listener.write({ label: plainLabel(this.#label.value) }),
      change: () => {
        this.#label.value = plainLabel(this.#label.value);
        listener.written();
      },
    });
    this.#note = h("textarea", {
      class: "finding-note",
      rows: 2,
      dir: "auto",
      placeholder: t("findings.note"),
      input: () => {
        this.#tellExcess();
        listener.write({ note: plainNote(this.#note.value) });
      },
      change: () => {
        // What is too long stays as it is typed, to be shortened by hand.
        if (this.#excess.hidden) this.#note.value = plainNote(this.#note.value);
        listener.written();
      },
    });
    this.#certainty = choice(
      `certainty-${finding.id}`,
      "",
      ["", ...CERTAINTIES],
      (one) => t(one === "" ? "findings.uncertain" : `certainty.${one}`),
      (one) => listener.certain(one === "" ? null : one),
    );
    this.#colour = h("input", { type: "color", change: () => listener.change({ colour: this.#colour.value }) });
    this.#dismissed = h("input", {
      type: "checkbox",
      change: () => listener.change({ is_dismissed: this.#dismissed.checked }),
    });
    const seen = h("input", { type: "checkbox", checked: isDrawn, change: () => listener.draw(seen.checked) });
    this.element = h(
      "li",
      { "data-id": finding.id },
      row(this.#go, this.#remove),
      this.#label,
      tall(t("findings.certainty"), this.#certainty),
      this.#note,
      this.#excess,
      line(
        t("findings.colour"),
        this.#colour,
        ticked(this.#dismissed, t("findings.dismiss")),
        ticked(seen, t("findings.drawn")),
      ),
      this.#where,
    );
  }

  get id(): string {
    return this.element.dataset["id"] ?? "";
  }

  set id(id: string) {
    this.element.dataset["id"] = id;
    this.#certainty.id = `certainty-${id}`;
  }

  /** Whether a finding of the same place says what stands here. */
  says({ label, note, points_in_patient }: Finding): boolean {
    const isHere = points_in_patient.join() === this.#finding.points_in_patient.join();
    return isHere && plainLabel(this.#label.value) === label && plainNote(this.#note.value) === note;
  }

  #tellExcess(): void {
    const excess = excessOf(this.#note.value, LONGEST_NOTE);
    const values = { most: number(LONGEST_NOTE), excess: number(excess) };
    tell(this.#excess, excess > 0 ? t("findings.excess", values) : "");
  }

  /** Shows the finding as it is now, with its number; null: it is dismissed. */
  show(finding: Finding, at: number | null): void {
    this.#finding = finding;
    const middle = middleOf(finding);
    const name = t(`findings.${finding.kind === "point" ? "name" : finding.kind}`, {
      number: at === null ? t("findings.dismissed") : number(at),
      side: t(`side.${finding.side ?? sideOf(middle, mirrorPlane(this.#shown))}`),
      depth: number(finding.depth_mm, 1),
    });
    setText(this.#go, name);
    const remove = t("findings.remove", { name });
    this.#remove.setAttribute("aria-label", remove);
    this.#remove.title = remove;
    for (const [field, words] of [
      [this.#label, "findings.label"],
      [this.#note, "findings.note"],
      [this.#certainty, "findings.certainty"],
      [this.#colour, "findings.colour"],
    ] as const)
      field.setAttribute("aria-label", `${name}: ${t(words)}`);
    // What is being typed says the same, but for a space at its end.
    if (plainLabel(this.#label.value) !== finding.label) this.#label.value = finding.label;
    if (plainNote(this.#note.value) !== finding.note) {
      this.#note.value = finding.note;
      this.#tellExcess();
    }
    setValue(this.#certainty, finding.certainty ?? "");
    setValue(this.#colour, finding.colour);
    this.#dismissed.checked = finding.is_dismissed;
    this.element.classList.toggle("dismissed", finding.is_dismissed);
    const author = finding.author && t("findings.by", { reader: finding.author });
    const gyrus = gyrusWords(finding.gyrus);
    const about = gyrus && `${t("gyrus.about")}: ${gyrus}`;
    setText(this.#where, [about, positionWords(middle), author].filter(Boolean).join(" · "));
  }
}
