// What the viewer does with parts of the page that are fetched when they are first wanted: sections of the panel, the
// profile, files.

import type { Case, ReadyCase } from "../model/case.ts";
import type { Finding } from "../model/findings.ts";
import type { Candidate, ListingMap } from "../model/maps.ts";
import type { Marked } from "../model/marks.ts";
import type { Measured, Profile } from "../model/profile.ts";
import { pictureBody } from "../model/series.ts";
import type { Vec3 } from "../model/space.ts";
import type { ViewState } from "../model/state.ts";
import { type Key, t } from "../base/i18n.ts";
import type { Actions } from "./actions.ts";
import type { OnScreen } from "./export.ts";
import { section } from "./fields.ts";
import type { ChecklistSection } from "./checklist-section.ts";
import type { FindingsSection, ReaderName } from "./findings-section.ts";
import { later } from "./later.ts";
import type { LayoutsSection } from "./layouts-section.ts";
import type { MeasuresSection } from "./measures-section.ts";
import type { Marks } from "../pacs/results.ts";
import type { PointTool } from "../panes/point-tool.ts";
import type { Sweep } from "./sweep.ts";

type Laid = Parameters<OnScreen["slices"]["lay"]>[0];
type Parts = Awaited<ReturnType<typeof later>>;

/** As far as rounding can move a point. */
const BORDER_MM = 0.05;

export interface OnDemandHost {
  readonly shown: ReadyCase;
  onScreen(): Omit<OnScreen, "shown">;
  readonly actions: Pick<Actions, "bring" | "change" | "command">;
  readonly announce: (words: string) => void;
  /** Scrolls to the panes, where the controls lie below them. */
  readonly lookAtPanes: () => void;
  readonly goTo: (depth_mm: number) => void;
  readonly made: (one: Case, wasThere: boolean) => void;
  /** The address of what is on the screen. */
  readonly address: () => string;
  /** The server has measured at the marked point. */
  measured(): void;
  complain(problem: unknown): void;
  /** Who reads. */
  readonly reader: ReaderName;
  /** The findings are these now. */
  listed(findings: readonly Finding[]): void;
}

/** What is marked in the panes. */
interface AllMarked {
  readonly findings: readonly Marked[];
  readonly measures: readonly Marked[];
}

export class OnDemand {
  readonly #host: OnDemandHost;
  #point: Vec3 | null = null;
  #measured: Measured | null = null;
  /** The sections of findings and of the ruler are being filled. */
  #met: Promise<void> | null = null;
  #isGone = false;
  #asked = new AbortController();
  /** The section of the findings, which is filled when the case is loaded. */
  readonly #findingsPlace = section(t("panel.findings"), true);
  #findings: FindingsSection | null = null;
  /** The section of the ruler, which is filled at the same time. */
  readonly #measuresPlace = section(t("panel.measure"), false);
  #measures: MeasuresSection | null = null;
  readonly #checklistPlace = section(t("panel.checklist"), false);
  #checklist: ChecklistSection | null = null;
  readonly #layoutsPlace = section(t("panel.layouts"), false);
  #layouts: LayoutsSection | null = null;
  #marked: AllMarked = { findings: [], measures: [] };

  constructor(host: OnDemandHost) {
    this.#host = host;
  }

  /** The sections with what a reader writes down, which are filled when the case is loaded. */
  get reading(): readonly HTMLElement[] {
    return [this.#findingsPlace, this.#measuresPlace, this.#checklistPlace, this.#layoutsPlace];
  }

  /** The sections of the panel that are filled when they are first opened. */
  sections(sweep: Sweep): readonly HTMLElement[] {
    const host = this.#host;
    return [
      this.#section("panel.case", ({ CaseSection }) => {
        const lay = (make: Laid): void => host.onScreen().slices.lay(make);
        return new CaseSection(host.shown, { lay, made: host.made }).element;
      }),
      this.#section("panel.sweep", ({ SweepSection }) => {
        return new SweepSection(host.shown, sweep.choice, (choice) => sweep.choose(choice)).element;
      }),
      this.#section("panel.export", ({ exportSection }) =>
        exportSection({ onScreen: () => this.#onScreen, sweep: () => sweep.choice, address: host.address }),
      ),
    ];
  }

  /** Plots the profile of a point; null where that cannot be done. */
  async plot(profile: Profile, point: Vec3): Promise<HTMLElement | null> {
    try {
      const { captionOf, fileStem, profileView, measuredAt } = await later();
      if (point !== this.#point) this.#measure(point, measuredAt);
      const { shown } = this.#host;
      const { state } = this.#onScreen;
      return profileView(profile, state.depth_mm, {
        go: this.#host.goTo,
        caption: () => captionOf(shown, this.#onScreen.state),
        name: fileStem(shown),
        measured: this.#measured,
      });
    } catch (problem) {
      this.#host.complain(problem);
      return null;
    }
  }

  /** Asks the server about a point, which is no longer asked about another one. */
  #measure(point: Vec3, ask: Parts["measuredAt"]): void {
    this.#point = point;
    this.#measured = null;
    this.#checklist?.place(undefined, undefined);
    this.#asked.abort();
    // Outside the envelope, and on its border, nothing is measured.
    if (!(Number(this.#host.onScreen().surface.probe(point)?.depth_mm) > BORDER_MM)) return;
    const { signal } = (this.#asked = new AbortController());
    ask(this.#host.shown.id, point, this.#onScreen.state.surface, signal).then(
      (measured) => {
        if (signal.aborted) return;
        this.#measured = measured;
        this.#checklist?.place(measured.own.lobe, measured.own.side);
        this.#host.measured();
      },
      // Without an answer the page's own curves stand alone.
      () => {},
    );
  }

  dispose(): void {
    this.#asked.abort();
    this.#isGone = true;
    this.#findings?.dispose();
    for (const part of [this.#measures, this.#checklist, this.#layouts]) part?.dispose();
  }

  /** Shows what was marked before, and lets more be marked and measured. */
  meetFindings(): void {
    const { shown, actions, announce, listed, reader } = this.#host;
    const meet = ({ FindingsSection, MeasuresSection, ChecklistSection, LayoutsSection }: Parts): void => {
      if (this.#isGone) return;
      const { surface } = this.#host.onScreen();
      const common = {
        shown,
        announce,
        state: () => this.#host.onScreen().state,
        depths: () => surface.surface.depths,
      };
      const findings = new FindingsSection({
        ...common,
        actions,
        listed: (list) => {
          listed(list);
          this.#measures?.listed();
        },
        reader,
        depthAt: (position) => surface.surface.wholeDepth(position),
        draw: (marked) => this.#mark({ findings: marked }),
      });
      this.#findings = findings;
      this.#measures = new MeasuresSection({
        ...common,
        draw: (marked) => this.#mark({ measures: marked }),
        keep: (finding) => findings.take(finding),
        lookAtPanes: this.#host.lookAtPanes,
        isFinding: (id) => findings.list.some((one) => one.id === id),
      });
      this.#checklist = new ChecklistSection(shown.id);
      this.#checklist.show(common.state());
      this.#layouts = new LayoutsSection({ ...common, actions });
      for (const [place, { element }] of [
        [this.#findingsPlace, findings],
        [this.#measuresPlace, this.#measures],
        [this.#checklistPlace, this.#checklist],
        [this.#layoutsPlace, this.#layouts],
      ] as const)
        place.querySelector(".group-body")?.replaceWith(element);
      void findings.load();
    };
    this.#met ??= later().then(meet);
    this.#met.catch(() => (this.#met = null));
  }

  /** Draws what is marked in all panes. */
  #mark(marked: Partial<AllMarked>): void {
    this.#marked = { ...this.#marked, ...marked };
    const { surface, slices, closer, map } = this.#host.onScreen();
    for (const panes of [surface, slices, closer, map]) panes?.mark(this.marked);
  }

  /** All that is marked and measured. */
  get marked(): readonly Marked[] {
    return [...this.#marked.findings, ...this.#marked.measures];
  }

  /** What sets points, while a reader measures. */
  get tool(): PointTool | null {
    return this.#measures?.isOn ? this.#measures : null;
  }

  /** Takes the ruler up, or lays it down. */
  async ruler(): Promise<void> {
    this.meetFindings();
    await this.#met?.catch((problem: unknown) => this.#host.complain(problem));
    this.#measures?.toggle();
    if (this.tool) this.#measuresPlace.setAttribute("open", "");
  }

  /** This is on the screen now. */
  look(state: ViewState): void {
    this.#checklist?.show(state);
  }

  /** Shows the saved layout of a number. */
  async recall(at: number): Promise<void> {
    this.meetFindings();
    await this.#met?.catch((problem: unknown) => this.#host.complain(problem));
    this.#layouts?.recall(at);
  }

  /** When the step of the findings was taken that can be undone; null: there is none. */
  get done_ms(): number | null {
    return this.#findings?.done_ms ?? null;
  }

  /** Undoes the last step of the findings, or does it again; whether there was one. */
  goTo(which: "undo" | "redo"): boolean {
    const findings = this.#findings;
    if (!findings || (which === "undo" ? findings.done_ms === null : !findings.canRedo)) return false;
    findings[which]();
    return true;
  }

  /** A place of the list becomes a finding, is dismissed, or neither. */
  judge(place: Candidate, judgement: "kept" | "dismissed" | null, map: ListingMap): void {
    this.#findings?.judge(place, judgement, map);
  }

  /** More is known of the surface. */
  surfaceKnown(): void {
    this.#findings?.redraw();
  }

  /** Adds once what there is for a case from DICOM; a server without a PACS has nothing. Until then, pictures are hidden. */
  meetNeighbour(viewer: HTMLElement): void {
    if (!this.#host.shown.links?.dicom || viewer.dataset.patient) return;
    viewer.dataset.patient = "awaited";
    const render = (side: number) => {
      const { state, surface } = this.#onScreen;
      return pictureBody(surface.surface.served(state), [side, side]);
    };
    const marks = (): Marks => this.#findings ?? { list: [], flush: async () => {} };
    const meet = ({ meetNeighbour }: Parts): unknown => meetNeighbour(this.#host.shown.id, viewer, render, marks);
    later()
      .then(meet)
      .catch(() => {})
      .finally(() => (viewer.dataset.patient = "met"));
  }

  get #onScreen(): OnScreen {
    const view = this.#host.onScreen();
    // The surface is not on the screen then.
    if (view.closer) return { ...view, shown: this.#host.shown };
    // A layer that is being fetched is not on the screen.
    return { ...view, state: { ...view.state, ...view.surface.layers }, shown: this.#host.shown };
  }

  /** A section of the panel that is filled when it is first opened. */
  #section(title: Key, fill: (parts: Parts) => HTMLElement): HTMLElement {
    const element = section(t(title), false);
    const wait = (): void => element.addEventListener("toggle", () => void open(), { once: true });
    const open = async (): Promise<void> => {
      try {
        const body = fill(await later());
        element.querySelector(".group-body")?.replaceWith(body);
      } catch (problem) {
        this.#host.complain(problem);
        wait();
      }
    };
    wait();
    return element;
  }
}
