// The section of the panel with the findings of a case: what a reader marks, writes down and hands on.

import { getFile } from "../base/api.ts";
import { h, iconButton, quiet, setText, tell } from "../base/dom.ts";
import { number, spoken, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { positionWords } from "../base/readout.ts";
import type { ReadyCase } from "../model/case.ts";
import { broughtTo } from "../model/commands.ts";
import { CERTAINTIES, type Finding, findingAt, middleOf, numbered } from "../model/findings.ts";
import { isMap } from "../model/maps.ts";
import { mirrorPlane, sideOf } from "../model/midsagittal.ts";
import type { ViewState } from "../model/state.ts";
import type { Actions } from "./actions.ts";
import { fileStem } from "./export.ts";
import { button, choice, line, row, tall, ticked } from "./fields.ts";
import { FindingsSync, type Kept } from "./findings-sync.ts";
import { saveFile } from "./picture-file.ts";

export interface FindingsSectionHost {
  readonly shown: ReadyCase;
  readonly actions: Pick<Actions, "change">;
  state(): ViewState;
  /** The depth of a place below the envelope, if it is known. */
  depthAt(position: readonly [number, number, number]): number | null;
  /** Draws the findings in the panes. */
  draw(findings: readonly Finding[]): void;
  announce(words: string): void;
}

export class FindingsSection {
  readonly element: HTMLElement;
  readonly #host: FindingsSectionHost;
  readonly #sync: FindingsSync;
  readonly #status = h("p", { class: "quiet", id: "findings-status", role: "status", hidden: true });
  readonly #list = h("ol", { class: "findings" });
  readonly #none = quiet(t("findings.none"));
  readonly #undo: HTMLButtonElement;
  /** The lists before each step of this reader. */
  #before: (readonly Finding[])[] = [];
  readonly #leave = (event: Event): void => {
    if (!this.#sync.isKept) event.preventDefault();
  };
  readonly #back = (): void => {
    if (!document.hidden) void this.load();
  };

  constructor(host: FindingsSectionHost) {
    this.#host = host;
    this.#sync = new FindingsSync({
      id: host.shown.id,
      shown: (list) => this.#show(list),
      kept: (kept, problem) => this.#tell(kept, problem),
      doubled: (count) => tell(this.#status, t("findings.doubled", { count: number(count) })),
    });
    this.#undo = button(t("findings.undo"), () => this.#goBack(), { "aria-label": t("findings.undo-last") });
    this.#undo.disabled = true;
    const add = button(t("findings.add"), () => this.#add());
    const report = button(t("findings.report"), () => void this.#save("report"));
    const table = button(t("findings.table"), () => void this.#save("findings"));
    this.element = h(
      "div",
      { class: "group-body" },
      row(add, this.#undo),
      this.#status,
      this.#none,
      this.#list,
      row(report, table),
    );
    addEventListener("beforeunload", this.#leave);
    document.addEventListener("visibilitychange", this.#back);
  }

  /** Reads what is stored. */
  async load(): Promise<void> {
    try {
      await this.#sync.load();
    } catch (problem) {
      tell(this.#status, problemWords(problem));
    }
  }

  dispose(): void {
    this.#sync.flush();
    removeEventListener("beforeunload", this.#leave);
    document.removeEventListener("visibilitychange", this.#back);
  }

  // -- What is stored

  #tell(kept: Kept, problem: unknown): void {
    if (kept === "kept") return tell(this.#status, t("findings.kept"));
    if (kept === "sending") return;
    const why = problemWords(problem);
    tell(this.#status, t(kept === "refused" ? "findings.refused" : "findings.unsent", { why }));
  }

  /** Changes the list in one step, which can be undone. */
  #step(list: readonly Finding[]): void {
    this.#before.push(this.#sync.list);
    this.#sync.change(list);
  }

  #goBack(): void {
    const before = this.#before.pop();
    if (before) this.#sync.change(before);
  }

  #change(id: string, change: Partial<Finding>): void {
    this.#step(this.#sync.list.map((finding) => (finding.id === id ? { ...finding, ...change } : finding)));
  }

  #add(): void {
    const { crosshair_mm, depth_mm, overlay } = this.#host.state();
    if (!crosshair_mm) return tell(this.#status, t("findings.no-point"));
    const map = overlay && isMap(overlay.name) ? overlay.name : null;
    const at = this.#host.depthAt(crosshair_mm) ?? depth_mm;
    const finding = findingAt(crosshair_mm, Math.max(0, Number(at.toFixed(2))), map);
    this.#step([...this.#sync.list, finding]);
    this.#list.querySelector<HTMLInputElement>(`[data-id="${finding.id}"] .finding-label`)?.focus();
  }

  // -- What is shown

  #show(list: readonly Finding[]): void {
    this.#undo.disabled = this.#before.length === 0;
    this.#none.hidden = list.length > 0;
    this.#host.draw(list);
    // What is being typed into stays as it is.
    const items = new Map([...this.#list.children].map((item) => [(item as HTMLElement).dataset["id"], item]));
    const numbers = new Map(numbered(list).map((finding, at) => [finding.id, at + 1]));
    const next = list.map((finding) => {
      const item = items.get(finding.id);
      const typing = item?.contains(document.activeElement) ?? false;
      return item && typing ? item : this.#item(finding, numbers.get(finding.id));
    });
    const isSame = next.every((item, at) => item === this.#list.children[at]);
    if (!isSame || next.length !== this.#list.children.length) this.#list.replaceChildren(...next);
  }

  #item(finding: Finding, at: number | undefined): HTMLElement {
    const { id } = finding;
    const { shown, actions } = this.#host;
    const middle = middleOf(finding);
    const side = finding.side ?? sideOf(middle, mirrorPlane(shown));
    const name = t("findings.name", {
      number: at === undefined ? t("findings.dismissed") : number(at),
      side: t(`side.${side}`),
      depth: number(finding.depth_mm, 1),
    });
    const go = button(
      name,
      () => actions.change(broughtTo(middle, finding.depth_mm, this.#host.state().layout, shown), true),
      { class: "finding-name" },
    );
    const remove = iconButton("trash", t("findings.remove", { name }), () => {
      this.#step(this.#sync.list.filter((one) => one.id !== id));
      this.#host.announce(t("findings.removed"));
    });
    const label = h("input", {
      type: "text",
      class: "finding-label",
      maxlength: 200,
      value: finding.label,
      dir: "auto",
      placeholder: t("findings.label"),
      "aria-label": `${name}: ${t("findings.label")}`,
      change: () => this.#change(id, { label: label.value.trim() }),
    });
    const note = h("textarea", {
      class: "finding-note",
      rows: 2,
      maxlength: 10_000,
      dir: "auto",
      placeholder: t("findings.note"),
      "aria-label": `${name}: ${t("findings.note")}`,
      change: () => this.#change(id, { note: note.value }),
    });
    note.value = finding.note;
    const certainty = choice(
      `certainty-${id}`,
      `${name}: ${t("findings.certainty")}`,
      ["", ...CERTAINTIES],
      (one) => t(one === "" ? "findings.uncertain" : `certainty.${one}`),
      (one) => {
        const rest = this.#sync.list.map((other) => {
          const { certainty: _old, ...others } = other;
          return other.id === id ? { ...others, ...(one !== "" && { certainty: one }) } : other;
        });
        this.#step(rest);
      },
    );
    certainty.value = finding.certainty ?? "";
    const colour = h("input", {
      type: "color",
      value: finding.colour,
      "aria-label": `${name}: ${t("findings.colour")}`,
      change: () => this.#change(id, { colour: colour.value }),
    });
    const dismissed = h("input", {
      type: "checkbox",
      checked: finding.is_dismissed,
      change: () => this.#change(id, { is_dismissed: dismissed.checked }),
    });
    return h(
      "li",
      { "data-id": id, class: finding.is_dismissed ? "dismissed" : null },
      row(go, remove),
      label,
      tall(t("findings.certainty"), certainty),
      note,
      line(t("findings.colour"), colour, ticked(dismissed, t("findings.dismiss"))),
      quiet(positionWords(middle)),
    );
  }

  // -- What is handed on

  /** Saves the report, or the table, of what the server has. */
  async #save(what: "report" | "findings"): Promise<void> {
    const { shown } = this.#host;
    tell(this.#status, t("export.working"));
    try {
      if (!this.#sync.isKept) this.#sync.flush();
      const isReport = what === "report";
      const path = isReport ? `${shown.id}/report?language=${spoken()}` : `${shown.id}/findings`;
      const file = await getFile(path, isReport ? "text/html" : "text/csv");
      saveFile(file, `${fileStem(shown)}-${what}.${isReport ? "html" : "csv"}`);
      setText(this.#status, t("findings.saved"));
    } catch (problem) {
      tell(this.#status, problemWords(problem));
    }
  }
}
