// The section of the panel with the findings of a case: what a reader marks, writes down and hands on.

import { Problem } from "../base/api.ts";
import { h, iconButton, quiet, tell } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { ReadyCase } from "../model/case.ts";
import {
  type Finding,
  LONGEST_LABEL,
  type NewFinding,
  areSame,
  findingOfPlace,
  isOff,
  markedFindings,
  merged,
  middleOf,
  newFinding,
  numbered,
  plainFinding,
  signed,
} from "../model/findings.ts";
import { Flows } from "../model/flow.ts";
import type { Depths } from "../model/isosurface.ts";
import { type Candidate, type ListingMap, isMap } from "../model/maps.ts";
import type { Marked } from "../model/marks.ts";
import type { ViewState } from "../model/state.ts";
import { plainLine } from "../model/text.ts";
import type { Actions } from "./actions.ts";
import { button, line, ticked } from "./fields.ts";
import { FindingRow } from "./finding-row.ts";
import { findingFiles } from "./findings-files.ts";
import { type FindingsHost, FindingsSync, type Kept } from "./findings-sync.ts";

/** Who reads, as the browser remembers it. */
export interface ReaderName {
  get(): string;
  set(name: string): void;
}

export interface FindingsSectionHost {
  readonly shown: ReadyCase;
  readonly actions: Pick<Actions, "bring">;
  state(): ViewState;
  /** The depth of a place below the envelope, if it is known. */
  depthAt(position: readonly [number, number, number]): number | null;
  /** The depth as a function of the position, once it is known. */
  depths(): Depths | null;
  /** Draws the findings in the panes. */
  draw(marked: readonly Marked[]): void;
  /** The list has changed. */
  listed(findings: readonly Finding[]): void;
  /** The author of new findings. */
  readonly reader: ReaderName;
  announce(words: string): void;
}

/** A change of the list. */
interface Step {
  readonly before: readonly Finding[];
  readonly after: readonly Finding[];
  /** When it was taken. */
  readonly at_ms: number;
}

/** What the server has not got yet of cases that were left, by case: it is sent again and again, and shown again. */
const UNSENT = new Map<string, FindingsSync>();

/** So long ways through findings are walked at once, in ms. */
const WALK_MS = 8;
/** They are not walked until the picture has been the same for so long, in ms. */
const MOVED_MS = 100;

export class FindingsSection {
  readonly element: HTMLElement;
  readonly #host: FindingsSectionHost;
  readonly #sync: FindingsSync;
  readonly #status = h("p", { class: "quiet", id: "findings-status", role: "status", hidden: true });
  /** That two readers changed the same: it stands until one of the findings is taken out. */
  readonly #doubled = h("p", { class: "doubtful", role: "status", hidden: true });
  readonly #list = h("ol", { class: "findings" });
  readonly #rows = new Map<string, FindingRow>();
  readonly #none = quiet(t("findings.none"));
  readonly #undo: HTMLButtonElement;
  readonly #redo: HTMLButtonElement;
  readonly #all = h("input", { type: "checkbox", id: "findings-shown", checked: true, change: () => this.#draw() });
  /** The lists before and after each step of this reader: those that can be undone, and those that were. */
  #done: Step[] = [];
  #undone: Step[] = [];
  /** The field that is being typed into, and the step that it makes. */
  #writing: { readonly field: string; readonly step: Step } | null = null;
  /** Those that are not drawn, as long as the page is open. */
  readonly #hidden = new Set<string>();
  #flows: Flows | null = null;
  #walking = 0;
  /** Whether what is stored could not be read, which is said. */
  #isUnread = false;
  readonly #leave = (event: Event): void => {
    if (this.#sync.isKept) return;
    event.preventDefault();
    // It may be there before the reader has answered.
    this.#sync.flush().catch(() => {});
  };
  readonly #turn = (): void => {
    if (!document.hidden) void this.load();
    // Nothing may be left of a page in the background.
    else this.#sync.flush().catch(() => {});
  };

  constructor(host: FindingsSectionHost) {
    this.#host = host;
    const hears: FindingsHost = {
      id: host.shown.id,
      shown: (list) => this.#show(list),
      kept: (kept, problem) => this.#tell(kept, problem),
      doubled: (count) => tell(this.#doubled, t("findings.doubled", { count: number(count) })),
    };
    this.#sync = UNSENT.get(host.shown.id) ?? new FindingsSync(hears);
    this.#sync.meet(hears);
    this.#undo = iconButton("undo", t("findings.undo-last"), () => this.undo());
    this.#redo = iconButton("redo", t("findings.redo-last"), () => this.redo());
    for (const one of [this.#undo, this.#redo]) one.disabled = true;
    const add = button(t("findings.add"), () => this.#add());
    const files = findingFiles({
      shown: host.shown,
      sync: this.#sync,
      status: this.#status,
      added: (before, after) => this.#did(before, after),
      doubled: (count) => tell(this.#doubled, t("findings.otherwise", { count: number(count) })),
    });
    const reader = h("input", {
      type: "text",
      id: "reader",
      maxlength: LONGEST_LABEL,
      value: host.reader.get(),
      dir: "auto",
      autocomplete: "off",
      "aria-label": t("findings.reader"),
      change: () => host.reader.set((reader.value = plainLine(reader.value, LONGEST_LABEL))),
    });
    this.element = h(
      "div",
      { class: "group-body" },
      line(t("findings.reader"), reader),
      h("div", { class: "row one-line" }, add, this.#undo, this.#redo),
      this.#status,
      this.#doubled,
      this.#none,
      ticked(this.#all, t("findings.shown")),
      this.#list,
      ...files,
    );
    if (this.#sync.list.length > 0) this.#show(this.#sync.list);
    addEventListener("beforeunload", this.#leave);
    document.addEventListener("visibilitychange", this.#turn);
  }

  /** Reads what is stored. */
  async load(): Promise<void> {
    try {
      await this.#sync.load();
      if (this.#isUnread) tell(this.#status, "");
      this.#isUnread = false;
    } catch (problem) {
      this.#isUnread = true;
      tell(this.#status, problemWords(problem));
    }
  }

  get list(): readonly Finding[] {
    return this.#sync.list;
  }

  /** Resolves when the server has all findings; rejects if it cannot have them. */
  flush(): Promise<void> {
    return this.#sync.flush();
  }

  dispose(): void {
    clearTimeout(this.#walking);
    const { id } = this.#host.shown;
    UNSENT.set(id, this.#sync);
    const forget = (): void => {
      UNSENT.delete(id);
      removeEventListener("beforeunload", this.#leave);
    };
    // Whoever closes the page is warned as long as the server has not got all of it; of a case that is deleted nothing is left.
    this.#sync.flush().then(forget, (problem: unknown) => {
      if (problem instanceof Problem && problem.status === 404) forget();
    });
    document.removeEventListener("visibilitychange", this.#turn);
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
    const before = new Set(this.#sync.list);
    const after = list.map((one) => (before.has(one) ? one : this.#own(one)));
    this.#did(this.#sync.list, after);
    this.#sync.change(after);
  }

  #did(before: readonly Finding[], after: readonly Finding[]): void {
    if (areSame(before, after)) return;
    this.#done.push({ before, after, at_ms: performance.now() });
    this.#undone = [];
    this.#ways();
    // Whoever takes one of the doubled findings out has seen them.
    if (numbered(after).length < numbered(before).length) tell(this.#doubled, "");
  }

  /** Shows whether there is a way back, and one forth again. */
  #ways(): void {
    this.#undo.disabled = this.#done.length === 0;
    this.#redo.disabled = this.#undone.length === 0;
  }

  /** When the step was taken that can be undone; null: there is none. */
  get done_ms(): number | null {
    return this.#done.at(-1)?.at_ms ?? null;
  }

  get canRedo(): boolean {
    return this.#undone.length > 0;
  }

  undo(): void {
    this.#go(this.#done, this.#undone);
  }

  redo(): void {
    this.#go(this.#undone, this.#done);
  }

  /** Takes the last step of a way back; what others have changed meanwhile stays. */
  #go(way: Step[], back: Step[]): void {
    const step = way.pop();
    if (!step) return;
    back.push({ before: step.after, after: step.before, at_ms: step.at_ms });
    this.#sync.change(merged(step.after, step.before, this.#sync.list).list);
  }

  /** What is typed is in the list at once, so that it is sent, or missed, as all of it is; what one field hears is one step. */
  #write(id: string, text: Partial<Pick<Finding, "label" | "note">>): void {
    const written = (list: readonly Finding[]): readonly Finding[] =>
      list.map((one) => (one.id === id ? this.#own({ ...one, ...text }) : one));
    const field = [id, ...Object.keys(text)].join();
    const step = this.#done.at(-1);
    if (step && this.#writing?.field === field && this.#writing.step === step) {
      const longer = { ...step, after: written(step.after), at_ms: performance.now() };
      this.#done[this.#done.length - 1] = longer;
      this.#writing = { field, step: longer };
      return this.#sync.change(written(this.#sync.list));
    }
    const after = written(this.#sync.list);
    // A space at the end says nothing yet.
    if (areSame(after, this.#sync.list)) return;
    this.#did(this.#sync.list, after);
    this.#writing = { field, step: this.#done.at(-1) as Step };
    this.#sync.change(after);
  }

  /** What this reader has made or changed. */
  #own(finding: Finding): Finding {
    return plainFinding(signed(finding, this.#host.reader.get()));
  }

  #change(id: string, change: Partial<Finding>): void {
    this.#step(this.#sync.list.map((finding) => (finding.id === id ? { ...finding, ...change } : finding)));
  }

  #add(): void {
    const { crosshair_mm, overlay } = this.#host.state();
    if (!crosshair_mm) return tell(this.#status, t("findings.no-point"));
    const from_map = overlay && isMap(overlay.name) ? { from_map: overlay.name } : {};
    this.take({ points_in_patient: [crosshair_mm], depth_mm: this.#depthAt(crosshair_mm), ...from_map });
  }

  #depthAt(position: readonly [number, number, number]): number {
    return this.#host.depthAt(position) ?? this.#host.state().depth_mm;
  }

  /** Adds a finding, to be written about; its id. */
  take(given: NewFinding): string {
    const finding = newFinding(given);
    this.#step([...this.#sync.list, finding]);
    this.#host.announce(t("findings.taken"));
    this.#writeAbout(finding);
    return finding.id;
  }

  /** Puts the hand where a finding gets its name, and that in sight. */
  #writeAbout({ id }: Finding): void {
    this.element.closest("details")?.setAttribute("open", "");
    this.#list.querySelector<HTMLInputElement>(`[data-id="${id}"] .finding-label`)?.focus();
  }

  /** Adds a place of the list, or says whether it is dismissed; `null`: it is no finding any more. */
  judge(
    { position_in_patient, depth_mm: known_mm }: Candidate,
    judgement: "kept" | "dismissed" | null,
    from_map: ListingMap,
  ): void {
    const before = findingOfPlace(this.#sync.list, position_in_patient);
    const is_dismissed = judgement === "dismissed";
    if (judgement === null) this.#step(this.#sync.list.filter((one) => one !== before));
    else if (before) this.#change(before.id, { is_dismissed });
    else {
      const depth_mm = known_mm ?? this.#depthAt(position_in_patient);
      const given = { points_in_patient: [position_in_patient], depth_mm, from_map, is_dismissed } as const;
      this.#step([...this.#sync.list, newFinding(given)]);
    }
    this.#host.announce(t(judgement ? `places.${judgement}` : "findings.removed"));
    const finding = findingOfPlace(this.#sync.list, position_in_patient);
    if (finding && judgement === "kept") this.#writeAbout(finding);
  }

  // -- What is shown

  #show(list: readonly Finding[]): void {
    this.#ways();
    this.#none.hidden = list.length > 0;
    this.#all.closest("label")?.toggleAttribute("hidden", list.length === 0);
    this.#draw();
    this.#host.listed(list);
    const focused = this.#list.contains(document.activeElement) ? (document.activeElement as HTMLElement) : null;
    this.#follow(list, focused);
    const ids = new Set(list.map(({ id }) => id));
    for (const [id, { element }] of this.#rows)
      if (!ids.has(id)) {
        element.remove();
        this.#rows.delete(id);
      }
    const numbers = new Map(numbered(list).map((finding, at) => [finding.id, at + 1]));
    for (const [at, finding] of list.entries()) {
      // A row stays where hands are: what is put in again loses the focus, and the click that is under way.
      const row = this.#rows.get(finding.id) ?? this.#row(finding);
      row.show(finding, numbers.get(finding.id) ?? null);
      const there = this.#list.children[at] ?? null;
      if (there !== row.element) this.#list.insertBefore(row.element, there);
    }
    // What is moved loses it.
    if (focused && focused !== document.activeElement) focused.focus();
  }

  /** Where another reader has changed what is being typed into, hands stay in their own finding, which has another id now. */
  #follow(list: readonly Finding[], focused: Element | null): void {
    const row = focused && [...this.#rows.values()].find(({ element }) => element.contains(focused));
    const theirs = row && list.find(({ id }) => id === row.id);
    const own = row && list.find((one) => !this.#rows.has(one.id) && row.says(one));
    if (!theirs || !own || row.says(theirs)) return;
    this.#rows.delete(row.id);
    if (this.#hidden.has(row.id)) this.#hidden.add(own.id);
    this.#rows.set(own.id, row);
    row.id = own.id;
  }

  #row(finding: Finding): FindingRow {
    const { shown, actions } = this.#host;
    const row: FindingRow = new FindingRow(finding, shown, !this.#hidden.has(finding.id), {
      go: (to) => actions.bring(middleOf(to), to.depth_mm, this.#host.state().layout),
      remove: () => {
        this.#step(this.#sync.list.filter((one) => one.id !== row.id));
        this.#host.announce(t("findings.removed"));
      },
      write: (text) => this.#write(row.id, text),
      written: () => (this.#writing = null),
      change: (change) => this.#change(row.id, change),
      certain: (certainty) => {
        const rest = this.#sync.list.map((other) => {
          const { certainty: _old, ...others } = other;
          return other.id === row.id ? { ...others, ...(certainty && { certainty }) } : other;
        });
        this.#step(rest);
      },
      draw: (isDrawn) => {
        if (isDrawn) this.#hidden.delete(row.id);
        else this.#hidden.add(row.id);
        this.#draw();
      },
    });
    this.#rows.set(finding.id, row);
    return row;
  }

  /** Draws the findings; their ways to other depths are walked a few at a time, and drawn when all are known. */
  #draw(): void {
    const { list } = this.#sync;
    const hidden = this.#all.checked ? this.#hidden : new Set(list.map(({ id }) => id));
    const slide = (position: readonly [number, number, number], depth_mm: number) =>
      this.#flows?.has(position) ? this.#flows.at(position, depth_mm) : position;
    const depths = this.#host.depths();
    this.#host.draw(markedFindings(list, hidden, slide, (finding) => depths !== null && isOff(depths, finding)));
    this.#walk();
  }

  #walk(): void {
    clearTimeout(this.#walking);
    const depths = this.#host.depths();
    if (!depths) return;
    const flows = (this.#flows = this.#flows?.depths === depths ? this.#flows : this.#flowsOf(depths));
    const unknown = this.#sync.list.flatMap((one) => one.points_in_patient).filter((point) => !flows.has(point));
    if (unknown.length === 0) return;
    const walkFrom = (start: number, seen: ViewState): void => {
      let at = start;
      const now = this.#host.state();
      // Who turns the head meanwhile is not kept waiting.
      const isMoving = now !== seen;
      const end = performance.now() + (isMoving ? 0 : WALK_MS);
      for (let point = unknown[at]; point && performance.now() < end; point = unknown[(at += 1)]) flows.at(point, 0);
      const next = (): void => (at < unknown.length ? walkFrom(at, now) : this.#draw());
      this.#walking = setTimeout(next, isMoving ? MOVED_MS : 0) as unknown as number;
    };
    walkFrom(0, this.#host.state());
  }

  #flowsOf(depths: Depths): Flows {
    return new Flows(depths, this.#host.shown.max_depth_mm);
  }

  /** The depth is known now, or that below another surface is shown. */
  redraw(): void {
    if (this.#flows?.depths !== this.#host.depths()) this.#draw();
  }
}
