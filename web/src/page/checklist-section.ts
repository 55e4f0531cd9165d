// The section of the panel that says which parts of the head were looked at, and for how long. It stays in the page.

import { h, quiet, setText } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { BANDS_MM, Checklist, LOBES, LOOKS, type LobeSide, type Look } from "../model/checklist.ts";
import type { Side } from "../model/midsagittal.ts";
import type { ViewState } from "../model/state.ts";
import { button, row } from "./fields.ts";

/** How often what is shown is written again, in ms. */
const TICK_MS = 1000;
/** A look of so many seconds fills a cell's bar. */
const FULL_S = 30;
const SIDES = ["left", "right"] as const;

/** What was looked at, by case, as long as the page is open. */
const LISTS = new Map<string, Checklist>();

const lookName = (look: Look): string => t(look === "slices" || look === "closer" ? `looked.${look}` : `view.${look}`);

export class ChecklistSection {
  readonly element: HTMLElement;
  readonly #list: Checklist;
  readonly #cells: readonly { readonly cell: HTMLElement; write(): void }[];
  readonly #timer: number;
  #state: ViewState | null = null;
  /** Where the mark is, if the server knows. */
  #lobe: LobeSide | null = null;
  readonly #byLobe: HTMLElement;
  readonly #look = (): void => this.#list.show(document.hidden ? null : this.#state, performance.now(), this.#lobe);

  constructor(id: string) {
    this.#list = LISTS.get(id) ?? new Checklist();
    LISTS.set(id, this.#list);
    const bands = BANDS_MM.map((band, at) => {
      const to = BANDS_MM[at + 1];
      return { band, depths: to === undefined ? `> ${number(band)}` : `${number(band)}–${number(to)}` };
    });
    const rows = bands.map(({ band, depths }) => ({ depths, cells: LOOKS.map((look) => this.#cell(look, band)) }));
    const lobes = LOBES.map((lobe) => ({
      lobe,
      sides: SIDES.map((side) => ({ side, cells: BANDS_MM.map((band) => this.#cell(`${lobe} ${side}`, band)) })),
    }));
    this.#cells = [...rows, ...lobes.flatMap(({ sides }) => sides)].flatMap(({ cells }) => cells);
    const heads = LOOKS.map((look) => h("th", { scope: "col", title: lookName(look) }, t(`letter.${look}`)));
    const clear = button(t("checklist.clear"), () => {
      this.#list.clear();
      this.#write();
    });
    this.#byLobe = h(
      "div",
      { class: "by-lobe", hidden: true },
      h(
        "table",
        { class: "checklist", "aria-label": t("checklist.lobes") },
        h(
          "thead",
          {},
          h(
            "tr",
            {},
            h("th", { scope: "col", colspan: 2 }, t("checklist.depth")),
            ...bands.map(({ depths }) => h("th", { scope: "col" }, depths)),
          ),
        ),
        ...lobes.map(({ lobe, sides }) =>
          h(
            "tbody",
            {},
            ...sides.map(({ side, cells }, at) =>
              h(
                "tr",
                {},
                ...(at === 0 ? [h("th", { scope: "rowgroup", rowspan: sides.length }, t(`lobe.${lobe}`))] : []),
                h("th", { scope: "row", title: t(`view.${side}`) }, t(`letter.${side}`)),
                ...cells.map(({ cell }) => cell),
              ),
            ),
          ),
        ),
      ),
      quiet(t("checklist.about-lobes")),
    );
    this.element = h(
      "div",
      { class: "group-body" },
      h(
        "table",
        { class: "checklist", "aria-label": t("panel.checklist") },
        h("thead", {}, h("tr", {}, h("th", { scope: "col" }, t("checklist.depth")), ...heads)),
        h(
          "tbody",
          {},
          ...rows.map(({ depths, cells }) =>
            h("tr", {}, h("th", { scope: "row" }, depths), ...cells.map(({ cell }) => cell)),
          ),
        ),
      ),
      quiet(t("checklist.about")),
      this.#byLobe,
      row(clear),
    );
    document.addEventListener("visibilitychange", this.#look);
    this.#timer = setInterval(() => this.#write(), TICK_MS) as unknown as number;
    this.#write();
  }

  /** This is on the screen now. */
  show(state: ViewState): void {
    this.#state = state;
    this.#look();
  }

  /** The mark is in a lobe; null: that is not known. */
  place(lobe: string | undefined, side: Side | undefined): void {
    const known = LOBES.find((one) => one === lobe);
    this.#lobe = known && side ? `${known} ${side}` : null;
    if (this.#lobe) this.#byLobe.hidden = false;
    this.#look();
  }

  dispose(): void {
    this.#state = null;
    this.#look();
    clearInterval(this.#timer);
    document.removeEventListener("visibilitychange", this.#look);
  }

  #cell(...[look, band]: Parameters<Checklist["seconds"]>): { readonly cell: HTMLElement; write(): void } {
    const cell = h("td", {});
    const write = (): void => {
      const seconds = this.#list.seconds(look, band);
      setText(cell, seconds > 0 ? `${number(seconds)} s` : "–");
      cell.classList.toggle("seen", seconds > 0);
      cell.style.setProperty("--share", `${100 * Math.min(seconds / FULL_S, 1)}%`);
    };
    return { cell, write };
  }

  /** Nobody sees a section that is closed. */
  #write(): void {
    if (this.element.isConnected && this.element.offsetParent === null) return;
    if (!document.hidden) this.#look();
    for (const { write } of this.#cells) write();
  }
}
