// What a sweep goes through, how fast, and whether it comes back.

import { h } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import type { ReadyCase } from "../model/case.ts";
import { SWEEP_SPEEDS, type SweepChoice, boundSweep } from "../model/sweep.ts";
import { choice, line, ticked } from "./fields.ts";

export class SweepSection {
  readonly element: HTMLElement;
  readonly #from: HTMLInputElement;
  readonly #to: HTMLInputElement;
  readonly #speed: HTMLSelectElement;
  readonly #turns: HTMLInputElement;

  constructor(shown: ReadyCase, first: SweepChoice, choose: (choice: SweepChoice) => void) {
    const take = (): void => {
      const wished = {
        from_mm: this.#from.valueAsNumber,
        to_mm: this.#to.valueAsNumber,
        mm_per_s: Number(this.#speed.value),
        turns: this.#turns.checked,
      };
      const bound = boundSweep(wished, shown);
      this.#show(bound);
      choose(bound);
    };
    const end = (id: string, label: string): HTMLInputElement =>
      h("input", { type: "number", id, min: 0, step: 0.5, "aria-label": label, change: take });
    this.#from = end("sweep-from", t("sweep.from"));
    this.#to = end("sweep-to", t("sweep.to"));
    this.#speed = choice("sweep-speed", t("sweep.speed"), SWEEP_SPEEDS, (speed) => `${number(speed)} mm/s`, take);
    this.#turns = h("input", { type: "checkbox", change: take });
    this.element = h(
      "div",
      { class: "group-body" },
      line(
        t("sweep.range"),
        this.#from,
        h("span", { class: "quiet" }, "–"),
        this.#to,
        h("span", { class: "quiet" }, "mm"),
      ),
      line(t("sweep.speed"), this.#speed),
      ticked(this.#turns, t("sweep.turns")),
    );
    this.#show(first);
  }

  #show({ from_mm, to_mm, mm_per_s, turns }: SweepChoice): void {
    this.#from.value = String(from_mm);
    this.#to.value = String(to_mm);
    this.#speed.value = String(mm_per_s);
    this.#turns.checked = turns;
  }
}
