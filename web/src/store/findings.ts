// The findings of a case: what a reader marks and writes, step by step, and how they are drawn.

import { type ReadonlySignal, type Signal, computed, effect, signal, untracked } from "@preact/signals";

import { t } from "../base/i18n.ts";
import {
  type Finding,
  type Judgement,
  type NewFinding,
  areSame,
  findingAt,
  isOff,
  markedFindings,
  merged,
  newFinding,
  numbered,
  plainFinding,
  signed,
  withOneAcpc,
} from "../model/findings.ts";
import { Flows } from "../model/flow.ts";
import type { Depths } from "../model/isosurface.ts";
import { type Candidate, type ListingMap, isMap } from "../model/maps.ts";
import type { Marked } from "../model/marks.ts";
import type { Vec3 } from "../model/space.ts";
import type { ViewState } from "../model/state.ts";
import { announce, note } from "./announce.ts";
import { FindingsSync } from "./findings-sync.ts";
import { preferences } from "./preferences.ts";
import { resumed } from "./sync.ts";
import type { View } from "./view.ts";

interface Step {
  readonly before: readonly Finding[];
  readonly after: readonly Finding[];
  readonly at_ms: number;
}

/** How often what others have changed is asked for while the page is looked at, in ms. */
const LOOK_MS = 5000;
/** So long ways through findings are walked at once, in ms. */
const WALK_MS = 8;
/** They are not walked until the picture has been the same for so long, in ms. */
const MOVED_MS = 100;

export class Findings {
  readonly sync: FindingsSync;
  readonly list: ReadonlySignal<readonly Finding[]>;
  /** Where the findings are, or what became of a file. */
  readonly status: Signal<string>;
  /** That two readers changed the same: it stands until one of the findings is taken out. */
  readonly doubled: Signal<string>;
  /** The finding whose name is to be written now. */
  readonly written = signal<string | null>(null);
  /** What the finding is known by that is unfolded in the list. */
  readonly open = signal<string | null>(null);
  /** The mark for which one was unfolded. */
  #marked: Vec3 | null = null;
  /** What those that are not drawn are known by, as long as the page is open. */
  readonly hidden = signal<ReadonlySet<string>>(new Set());
  /** As they are drawn. */
  readonly marked = signal<readonly Marked[]>([]);
  readonly #view: View;
  readonly #depths: ReadonlySignal<Depths | null>;
  /** The depth of a place below the envelope, if it is known. */
  readonly #depthAt: (position: Vec3) => number | null;
  /** The steps of this reader: those that can be undone, and those that were. */
  readonly #done: Signal<readonly Step[]> = signal([]);
  readonly #undone: Signal<readonly Step[]> = signal([]);
  readonly canUndo = computed(() => this.#done.value.length > 0);
  readonly canRedo = computed(() => this.#undone.value.length > 0);
  /** The ids of what this reader has made or changed here. */
  readonly #made = new Set<string>();
  /** The field that is being typed into, and the step that it makes. */
  #writing: { readonly field: string; readonly step: Step } | null = null;
  #flows: Flows | null = null;
  #walking = 0;
  readonly #ends: readonly (() => void)[];
  readonly #looking: number;

  constructor(view: View, depths: ReadonlySignal<Depths | null>, depthAt: (position: Vec3) => number | null) {
    this.#view = view;
    this.#depths = depths;
    this.#depthAt = depthAt;
    const path = `v1/cases/${view.shown.id}/findings`;
    this.sync = resumed(path, () => new FindingsSync(path));
    ({ value: this.list, status: this.status, doubled: this.doubled } = this.sync);
    this.#ends = [
      effect(() => this.#draw()),
      // Where the mark comes to a finding, that one is unfolded.
      effect(() => {
        const mark = this.#view.state.value.crosshair_mm;
        const found = mark && mark !== this.#marked ? findingAt(this.list.value, mark) : undefined;
        if (!found) return;
        this.#marked = mark;
        this.unfold(found);
      }),
    ];
    this.#looking = window.setInterval(() => {
      if (!document.hidden) this.sync.look().catch(() => {});
    }, LOOK_MS);
  }

  dispose(): void {
    clearTimeout(this.#walking);
    clearInterval(this.#looking);
    for (const end of this.#ends) end();
    this.sync.dispose();
  }

  // -- What a reader does

  add(): void {
    const { crosshair_mm, overlay } = this.#view.seen.peek();
    if (!crosshair_mm) return note(t("findings.no-point"));
    const from_map = overlay && isMap(overlay.name) ? { from_map: overlay.name } : {};
    this.take({ points_in_patient: [crosshair_mm], depth_mm: this.#depthOf(crosshair_mm), ...from_map });
  }

  /** Adds a finding, to be written about; its id. */
  take(given: NewFinding): string {
    const finding = newFinding(given);
    this.#step([...this.#list, finding]);
    announce(t("findings.taken"));
    this.#writeAbout(finding);
    return finding.id;
  }

  /** Shows in the list what is written about a finding. */
  unfold(finding: Finding): void {
    this.open.value = this.sync.keyOf(finding);
  }

  #writeAbout(finding: Finding): void {
    this.unfold(finding);
    this.written.value = finding.id;
  }

  remove(id: string): void {
    this.#step(this.#list.filter((one) => one.id !== id));
    announce(t("findings.removed"));
  }

  change(id: string, change: Partial<Finding>): void {
    this.#edit(id, (one) => ({ ...one, ...change }));
  }

  rate(id: string, certainty: Finding["certainty"]): void {
    this.#edit(id, ({ certainty: _before, ...others }) => ({ ...others, ...(certainty && { certainty }) }));
  }

  /** The reader has looked at the place of a finding that was taken over. */
  confirm(id: string): void {
    this.#edit(id, ({ is_unconfirmed: _before, ...confirmed }) => confirmed);
    announce(t("findings.confirmed"));
  }

  /** What is typed is in the list at once, so that it is sent, or missed, as all of it is; what one field hears is one step. */
  write(id: string, text: Partial<Pick<Finding, "label" | "note">>): void {
    const written = (list: readonly Finding[]): readonly Finding[] =>
      list.map((one) => (one.id === id ? own({ ...one, ...text }) : one));
    this.#made.add(id);
    const field = [id, ...Object.keys(text)].join();
    const step = this.#done.peek().at(-1);
    const after = written(this.#list);
    if (step && this.#writing?.field === field && this.#writing.step === step) {
      const longer = { ...step, after: written(step.after), at_ms: performance.now() };
      this.#done.value = this.#done.peek().with(-1, longer);
      this.#writing = { field, step: longer };
    } else {
      // A space at the end says nothing yet.
      if (areSame(after, this.#list)) return;
      this.did(this.#list, after);
      this.#writing = { field, step: this.#done.peek().at(-1) as Step };
    }
    this.sync.change(after);
  }

  /** The field that was typed into is left. */
  leaveField(): void {
    this.#writing = null;
  }

  /** Whoever states their name after they have made findings has made these as well. */
  signOwn(): void {
    this.#step(this.#list.map((one) => (this.#made.has(one.id) ? { ...one } : one)));
  }

  /** Draws a finding in the panes, or not. */
  show(finding: Finding, isDrawn: boolean): void {
    const hidden = new Set(this.hidden.peek());
    if (isDrawn) hidden.delete(this.sync.keyOf(finding));
    else hidden.add(this.sync.keyOf(finding));
    this.hidden.value = hidden;
  }

  /** Makes a place of a list a finding, which is kept or dismissed. */
  judge({ position_in_patient, depth_mm: known_mm }: Candidate, judgement: Judgement, from_map: ListingMap): void {
    const depth_mm = known_mm ?? this.#depthOf(position_in_patient);
    const is_dismissed = judgement === "dismissed";
    const made = newFinding({ points_in_patient: [position_in_patient], depth_mm, from_map, is_dismissed });
    this.#step([...this.#list, made]);
    this.rule(made, judgement);
  }

  /** Keeps a finding, to be written about, or dismisses it. */
  rule(finding: Finding, judgement: Judgement): void {
    const is_dismissed = judgement === "dismissed";
    if (finding.is_dismissed !== is_dismissed) this.change(finding.id, { is_dismissed });
    announce(t(`places.${judgement}`));
    if (!is_dismissed) this.#writeAbout(finding);
  }

  get #list(): readonly Finding[] {
    return this.list.peek();
  }

  #depthOf(position: Vec3): number {
    return this.#depthAt(position) ?? this.#view.now.depth_mm;
  }

  // -- Steps

  /** When the step was taken that can be undone; null: there is none. */
  get done_ms(): number | null {
    return this.#done.peek().at(-1)?.at_ms ?? null;
  }

  undo(): void {
    this.#go(this.#done, this.#undone);
  }

  redo(): void {
    this.#go(this.#undone, this.#done);
  }

  /** The list was changed in a step that can be undone. */
  did(before: readonly Finding[], after: readonly Finding[]): void {
    if (areSame(before, after)) return;
    this.#done.value = [...this.#done.peek(), { before, after, at_ms: performance.now() }];
    this.#undone.value = [];
    // Whoever takes one of the doubled findings out has seen them.
    if (numbered(after).length < numbered(before).length) this.doubled.value = "";
  }

  #edit(id: string, edited: (finding: Finding) => Finding): void {
    this.#step(this.#list.map((one) => (one.id === id ? edited(one) : one)));
  }

  #step(list: readonly Finding[]): void {
    const before = new Set(this.#list);
    const isOld = (one: Finding): boolean => before.has(one);
    for (const { id } of list.filter((one) => !isOld(one))) this.#made.add(id);
    const all = list.map((one) => (isOld(one) ? one : own(one)));
    const after = withOneAcpc(all, (one) => !isOld(one));
    this.did(this.#list, after);
    this.sync.change(after);
  }

  /** Takes the last step of a way back; what others have changed meanwhile stays. */
  #go(way: Signal<readonly Step[]>, back: Signal<readonly Step[]>): void {
    const step = way.peek().at(-1);
    if (!step) return;
    way.value = way.peek().slice(0, -1);
    back.value = [...back.peek(), { before: step.after, after: step.before, at_ms: step.at_ms }];
    this.sync.change(merged(step.after, step.before, this.#list).list);
  }

  // -- What is drawn

  /** Draws the findings; their ways to other depths are walked a few at a time, and drawn when all are known. */
  #draw(): void {
    const list = this.list.value;
    const depths = this.#depths.value;
    const isHidden = (one: Finding): boolean => this.hidden.value.has(this.sync.keyOf(one));
    const hidden = new Set(list.filter(isHidden).map(({ id }) => id));
    const slide = (position: Vec3, depth_mm: number): Vec3 =>
      this.#flows?.has(position) ? this.#flows.at(position, depth_mm) : position;
    untracked(() => {
      const off = (one: Finding): boolean => depths !== null && isOff(depths, one);
      this.marked.value = markedFindings(list, hidden, slide, off, t("findings.acpc"));
      if (depths) this.#walk(list, depths);
    });
  }

  #walk(list: readonly Finding[], depths: Depths): void {
    clearTimeout(this.#walking);
    if (this.#flows?.depths !== depths) this.#flows = new Flows(depths, this.#view.shown.max_depth_mm);
    const flows = this.#flows;
    const unknown = list.flatMap((one) => one.points_in_patient).filter((point) => !flows.has(point));
    if (unknown.length === 0) return;
    const walkFrom = (start: number, seen: ViewState): void => {
      let at = start;
      const { now } = this.#view;
      // Who turns the head meanwhile is not kept waiting.
      const isMoving = now !== seen;
      const end = performance.now() + (isMoving ? 0 : WALK_MS);
      for (let point = unknown[at]; point && performance.now() < end; point = unknown[(at += 1)]) flows.at(point, 0);
      const next = (): void => (at < unknown.length ? walkFrom(at, now) : this.#draw());
      this.#walking = setTimeout(next, isMoving ? MOVED_MS : 0) as unknown as number;
    };
    walkFrom(0, this.#view.now);
  }
}

/** What this reader has made or changed. */
const own = (finding: Finding): Finding => plainFinding(signed(finding, preferences.peek().reader));
