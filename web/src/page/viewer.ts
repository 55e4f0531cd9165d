// The chosen case: one state, the panes that show it, and what changes it.

import type { ReadyCase } from "../model/case.ts";
import {
  DEEP_MM,
  broughtInside,
  broughtTo,
  changeOf,
  innerSideOf,
  laidOut,
  otherSide,
  turnedTo,
} from "../model/commands.ts";
import { type Change, type Command, dragWindow } from "../model/controls.ts";
import { readState, writeAddress } from "../model/fragment.ts";
import { distance_mm, mirrorPlane } from "../model/midsagittal.ts";
import type { StateHistory } from "../model/history.ts";
import type { Left } from "../model/memory.ts";
import type { Picked } from "../model/points.ts";
import type { Vec2, Vec3 } from "../model/space.ts";
import { clampDepth, type Layout, type ViewState, hasSlices, leftOf } from "../model/state.ts";
import { isHalf } from "../model/surfaces.ts";
import { Problem } from "../base/api.ts";
import { h } from "../base/dom.ts";
import { type Key, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { positionWords, valueWords } from "../base/readout.ts";
import type { Closer } from "../panes/closer.ts";
import type { MapPane, MapPaneListener } from "../panes/flat-map.ts";
import { SliceGroup } from "../panes/slice-group.ts";
import type { SliceListener } from "../panes/slice-parts.ts";
import type { Surface, SurfaceStatus } from "../panes/surface.ts";
import { SurfacePane, type SurfacePaneListener } from "../panes/surface-pane.ts";
import type { Actions } from "./actions.ts";
import { Aids, type AidsListener } from "./aids.ts";
import { AddressFollower } from "./address.ts";
import { DepthBar, explanation } from "./depth-bar.ts";
import { later } from "./later.ts";
import { Notices } from "./notices.ts";
import { OnDemand } from "./on-demand.ts";
import { Panel, linkedZoom } from "./panel.ts";
import { pointWords } from "./point-section.ts";
import { Speaker, spokenCommand } from "./spoken.ts";
import { Sweep } from "./sweep.ts";
import type { ViewerHost } from "./viewer-host.ts";

export class Viewer {
  readonly element: HTMLElement;
  readonly panel: Panel;
  readonly shown: ReadyCase;
  readonly #host: ViewerHost;
  readonly #panes: HTMLElement;
  readonly #surface: SurfacePane;
  readonly #slices: SliceGroup;
  /** The close-up, while it is shown. */
  #closer: Closer | null = null;
  /** The flat map, while it is shown. */
  #map: MapPane | null = null;
  /** What the close-up was opened from. */
  #beforeCloser: Pick<ViewState, "layout" | "beside"> = { layout: "both", beside: null };
  readonly #notices: Notices;
  readonly #depthBar: DepthBar;
  readonly #address: AddressFollower;
  readonly #sweep: Sweep;
  readonly #onDemand: OnDemand;
  readonly #aids: Aids;
  readonly #speaker: Speaker;
  readonly #observer: ResizeObserver;
  readonly #history: StateHistory;
  /** When the view changed last. */
  #changed_ms = 0;
  /** What was undone, the last at the end. */
  readonly #undone: ("view" | "findings")[] = [];
  #loadAbort = new AbortController();
  #state: ViewState;
  #picked: Picked | null = null;
  /** A double click before the surface was loaded. */
  #wanted: { readonly place: Vec2; readonly state: ViewState } | null = null;
  /** A place that is shown as soon as the inner side on which it is seen is here, by its depth below the whole brain. */
  #awaited: { readonly position: Vec3; readonly depth_mm: number } | null = null;
  /** The line that explains the depth slider, and the depth at which it need not be explained any more. */
  readonly #explained: { readonly line: HTMLElement; readonly depth_mm: number } | null;
  /** What was shown before a hand moved the cross in a slice: one step back undoes its whole way. */
  #unmoved: ViewState | null = null;
  /** What was shown before each of the last two clicks in a slice: a double click enlarges it and moves nothing. */
  #unclicked: readonly (ViewState | undefined)[] = [];
  #frame = 0;
  #moving = false;
  #timerShown = false;
  #disposed = false;
  /** Whether somebody else has the surface now. */
  #isReleased = false;

  constructor(shown: ReadyCase, rest: string, host: ViewerHost) {
    this.shown = shown;
    this.#host = host;
    this.#history = host.left.history;
    // An address that says something says all; one that names the case alone leaves it as it was.
    const left = host.left.state;
    const isAsLeft = rest === "" || `#${shown.id}&${rest}` === writeAddress(left, shown);
    const { state, unread } = isAsLeft ? { state: left, unread: [] } : readState(rest, shown);
    this.#state = state;
    this.#history.record(state);
    this.#speaker = new Speaker(host.announce);
    const actions = this.#actions();
    this.#depthBar = new DepthBar(shown, actions);
    this.#notices = new Notices({ cancelLoad: () => this.#loadAbort.abort(), loadAgain: () => void this.load() });
    const rested = (): void => this.#onRest();
    this.#address = new AddressFollower(shown, () => this.#state, rested);
    const sweep = (depth_mm: number): void => this.#change({ depth_mm });
    this.#sweep = new Sweep(shown, () => this.#state.depth_mm, sweep);
    this.#onDemand = this.#makeOnDemand();
    const redraw = (): void => this.#schedule();
    const complain = (problem: unknown): void => this.#notices.complain(problem);
    const forget = (name: string): void => this.#surface.surface.forgetLayer(name);
    const chart = (place: HTMLElement | null): void => this.panel.point.stand(place);
    const judge: AidsListener["judge"] = (...judged) => this.#onDemand.judge(...judged);
    this.#aids = new Aids(shown, { actions, redraw, announce: host.announce, complain, forget, chart, judge });
    const linking = linkedZoom(host.preferences().linked_zoom, (linked_zoom) => {
      host.choose({ linked_zoom });
      if (linked_zoom) this.#slices.link();
    });
    const sections = {
      maps: this.#aids.elements[0],
      layers: this.#aids.elements[1],
      drawing: [linking],
      reading: this.#onDemand.reading,
      last: this.#onDemand.sections(this.#sweep),
    };
    this.panel = new Panel(shown, actions, sections, (task) => host.choose({ task }));
    this.panel.choose(host.preferences().task);
    const closeAcross = (): void => this.#showAcross(null);
    this.#slices = new SliceGroup(shown, { load: later, closeAcross, ...this.#sliceListener() });
    const swipe = ({ detail }: CustomEvent<number>): void => this.#change({ swipe: { share: detail } });
    const follow = ({ detail }: CustomEvent<Change>): void => actions.change(detail);
    const keydown = ({ key }: KeyboardEvent): void => {
      if (key !== "Escape") return;
      const isLarge = this.#panes.querySelector(".large") !== null;
      if (isLarge || this.#state.layout !== "closer") this.#shrink();
      else this.#stepBack();
    };
    this.#panes = h("div", { class: "panes", swipe, follow, keydown });
    this.element = h("div", { class: "viewer" }, this.#notices.element, this.#panes);
    const knows = (): void => host.choose({ knows_depth: true });
    this.#explained = host.preferences().knows_depth
      ? null
      : { line: explanation(knows), depth_mm: this.#state.depth_mm };
    if (this.#explained) this.element.append(this.#explained.line);
    this.element.append(this.#depthBar.element);
    this.#surface = this.#surfacePane();
    const [closer, map] = [h("div", { class: "closer" }), h("div", { class: "flat-map" })];
    this.#panes.append(map, this.#surface.element, this.#slices.element, closer, this.#notices.loading);
    this.#observer = new ResizeObserver(redraw);
    for (const { element } of [this.#surface, this.#slices]) this.#observer.observe(element);
    this.#notices.unread(unread);
    this.#state = this.#aids.paired(state);
    this.#apply({});
  }

  /** How the case is left. */
  get left(): Left {
    return { state: this.#state, history: this.#history };
  }

  /** Begins to fetch what the surface draws with; the element is in the page by now. */
  async load(): Promise<void> {
    this.#loadAbort = new AbortController();
    this.#notices.begin();
    // No picture is seen before its patient.
    this.#onDemand.meetNeighbour(this.element);
    try {
      await this.#surface.surface.load(this.#loadAbort.signal, (progress) => this.#notices.progress(progress));
      this.#notices.end();
    } catch (error) {
      this.#notices.end();
      if (this.#disposed) return;
      if (this.#loadAbort.signal.aborted) {
        this.#notices.cancelled();
        this.#host.announce(t("load.cancelled"));
      } else this.#notices.complain(error);
    }
    this.element.dataset.loaded = "true";
    this.#onDemand.meetFindings();
    void this.#aids.load().catch(() => {});
    if (this.#wanted) this.#pick(this.#wanted.place, this.#wanted.state);
    this.#wanted = null;
    this.#showPoint();
    this.#schedule();
  }

  /** Shows what the address says, which Back has changed. */
  restore(rest: string): void {
    const { state, unread } = readState(rest, this.shown);
    this.#take(state);
    this.#notices.unread(unread);
  }

  setLayout(layout: Layout): void {
    this.#shrink();
    if (layout === "closer") return this.#lookCloser();
    this.#change(laidOut(layout, this.#state, this.shown), true);
    this.#host.announce(t(`layout.${layout}`));
    this.#lookAtPanes();
  }

  /** Where the controls lie below the panes, scrolls to the panes. */
  #lookAtPanes(): void {
    this.element.scrollIntoView({ block: "start" });
  }

  /** Shows the close-up of the marked place. */
  #lookCloser(): void {
    const { layout, beside, crosshair_mm } = this.#state;
    if (layout === "closer") return;
    if (!crosshair_mm) return this.#tellMissed("closer.unmarked");
    this.#beforeCloser = { layout, beside };
    this.#change({ layout: "closer" }, true);
    this.#host.announce(t("layout.closer"));
    this.#lookAtPanes();
  }

  /** Shows the slice across the sulcus at the mark, turned by so much, or takes it away. */
  #showAcross(across_deg: number | null): void {
    const { layout } = this.#state;
    if (across_deg !== null && !this.#state.crosshair_mm) return this.#tellMissed("across.unmarked");
    this.#shrink();
    const others = hasSlices({ layout })
      ? {}
      : laidOut(layout === "mirror" ? "both" : "slices", this.#state, this.shown);
    this.#change({ across_deg, ...(across_deg !== null && others) }, true);
    this.#host.announce(t(across_deg === null ? "across.hidden" : "across.shown"));
    if (across_deg !== null) this.#lookAtPanes();
  }

  /** Shows what was shown before the close-up. */
  #stepBack(): void {
    this.#change(this.#beforeCloser, true);
    this.#host.announce(t(`layout.${this.#beforeCloser.layout}`));
  }

  #sliceListener(): Omit<SliceListener, "enlarge" | "zoomed"> {
    const { preferences } = this.#host;
    return {
      resized: (isDoubleClick) => {
        if (isDoubleClick && this.#unclicked[0]) this.#take(this.#unclicked[0]);
        this.#schedule();
      },
      move: (position, done) => this.#moveCross(position, done),
      scroll: (position) => this.#moveCross(position, false),
      missed: () => this.#tellMissed("point.beside"),
      values: (position) => this.#valuesAt(position),
      window: (move) => this.#change(dragWindow(this.#state, this.shown, move, preferences().drag)),
      surface: () => this.#surface.surface,
      turned: (across_deg) => this.#change({ across_deg }),
      tool: () => this.#onDemand.tool,
      hasOneZoom: () => preferences().linked_zoom,
      complain: (problem) => this.#notices.complain(problem),
    };
  }

  /** Shows the close-up, or takes it away. */
  async #showCloser(state: ViewState): Promise<void> {
    if (state.layout !== "closer") {
      this.#closer?.dispose();
      this.#closer = null;
      return;
    }
    if (!this.#closer) {
      const { Closer } = await later();
      if (this.#disposed || this.#state.layout !== "closer" || this.#closer) return;
      this.#closer = new Closer(this.shown, {
        ...this.#sliceListener(),
        window: (move, isRight) => this.#dragHalf(move, isRight),
      });
      this.#closer.outline(this.#panes.dataset.bare !== "true");
      this.#closer.mark(this.#onDemand.marked);
      this.#panes.querySelector(".closer")?.replaceWith(this.#closer.element);
      this.#observer.observe(this.#closer.element);
    }
    this.#closer.show(this.#aids.drawable(this.#state));
  }

  /** Shows the flat map, or takes it away. */
  async #showMap(state: ViewState): Promise<void> {
    if (state.layout !== "map") {
      if (!this.#map) return;
      this.#map.element.replaceWith(h("div", { class: "flat-map" }));
      this.#map.dispose();
      this.#map = null;
      return;
    }
    if (!this.#map) {
      const { MapPane } = await later();
      if (this.#disposed || this.#state.layout !== "map" || this.#map) return;
      const map = (this.#map = new MapPane(this.shown, this.#mapListener()));
      map.mark(this.#onDemand.marked);
      this.#panes.querySelector(".flat-map")?.replaceWith(map.element);
      this.#observer.observe(map.element);
    }
    this.#map.show(this.#aids.drawable(this.#state));
  }

  #mapListener(): MapPaneListener {
    return {
      surface: () => this.#surface.surface,
      hands: () => this.#host.preferences(),
      change: (change) => this.#change(change),
      command: (command) => this.command(command),
      mark: (position) => this.#moveCross(position, true),
      missed: () => this.#tellMissed("point.none"),
      tool: () => this.#onDemand.tool,
      busy: (busy) => {
        this.#moving = busy;
        if (!busy) this.#schedule();
      },
      remark: (words) => this.remark(words),
      complain: (problem) => this.#notices.complain(problem),
    };
  }

  /** A drag changes the window of the half that it is in. */
  #dragHalf(move: Vec2, isRight: boolean): void {
    const { beside } = this.#state;
    const { drag } = this.#host.preferences();
    if (isRight || !beside) return this.#change(dragWindow(this.#state, this.shown, move, drag));
    const { window = beside.window } = dragWindow(leftOf(this.#state), this.shown, move, drag);
    this.#change({ beside: { ...beside, window } });
  }

  /** Shows all panes again. */
  #shrink(): void {
    this.#panes.querySelector<HTMLElement>(".large .icon-button")?.click();
  }

  /** A key that no control has taken, or a button. */
  command(command: Command): void {
    if (command.kind === "nudge") this.panel.reach("layers");
    if (this.#aids.take(command)) return;
    switch (command.kind) {
      case "play":
        return this.#sweep.isRunning ? this.#stopSweep() : this.#sweep.start();
      case "timer":
        this.#surface.surface.showTimer((this.#timerShown = !this.#timerShown));
        return this.#schedule();
      case "outline": {
        const hides = this.#slices.strip();
        this.#closer?.outline(!hides);
        this.#panes.dataset.bare = String(hides);
        return this.#host.announce(t(hides ? "outline.hidden" : "outline.shown"));
      }
      case "closer":
        return this.#state.layout === "closer" ? this.#stepBack() : this.#lookCloser();
      case "across": {
        const { across_deg, layout } = this.#state;
        return this.#showAcross(across_deg === null || !hasSlices({ layout }) ? (across_deg ?? 0) : null);
      }
      case "flat-map": {
        const { layout, map } = this.#state;
        if (layout !== "map") return this.setLayout("map");
        this.#change({ map: { ...map, has_inner: !map.has_inner } }, true);
        return this.#host.announce(t(map.has_inner ? "flat-map.outer-shown" : "flat-map.inner-shown"));
      }
      case "place":
        return void this.#aids.step(command.steps);
      case "patient":
        document.body.classList.toggle("no-patient");
        return;
      case "layouts":
        return this.#host.announce(t("layouts.await"));
      case "recall":
        return void this.#onDemand.recall(command.number);
      case "ruler":
        this.panel.reach("read");
        return void this.#onDemand.ruler();
      case "mark": {
        const [width, height] = this.#surface.size();
        const { tool } = this.#onDemand;
        if (!tool) return this.#pick([width / 2, height / 2]);
        const picked = this.#surface.pick([width / 2, height / 2]);
        return picked ? tool.add(picked.position_in_patient, "surface") : this.#tellMissed("point.none");
      }
      case "help":
        return this.#host.help();
      case "undo":
      case "redo":
        return this.#goTo(command.kind);
    }
    if (command.kind === "depth" || command.kind === "reset") this.#stopSweep();
    if (command.kind === "reset") {
      this.#picked = null;
      this.#slices.center();
      this.#closer?.center();
    }
    const { change, isStep } = changeOf(command, this.#state, this.shown, this.#surface.size());
    this.#change(change, isStep);
    const words = command.kind === "surface" ? t(`surface.${this.#state.surface}-said`) : spokenCommand(command);
    if (words) this.#host.announce(words);
  }

  /** Something about the case to know, which can be dismissed. */
  remark(words: string): void {
    this.#notices.remark(words);
  }

  /** Failed requests are repeated. */
  again(): void {
    this.#notices.trouble("");
    this.#schedule();
  }

  /** Brings the address to where a sweep is, before the page is built again from it. */
  settle(): void {
    this.#stopSweep();
    this.#address.replace();
  }

  /** Hands over what draws the case; the viewer itself is done with. */
  release(): Surface {
    this.#isReleased = true;
    return this.#surface.surface;
  }

  dispose(): void {
    this.#disposed = true;
    this.#stopSweep();
    this.#address.stop();
    cancelAnimationFrame(this.#frame);
    this.#loadAbort.abort();
    this.#observer.disconnect();
    for (const part of [this.#slices, this.#closer, this.#map, this.#aids, this.#onDemand]) part?.dispose();
    if (!this.#isReleased) this.#surface.surface.dispose();
    for (const { element } of [this, this.panel]) element.remove();
  }

  #makeOnDemand(): OnDemand {
    return new OnDemand({
      shown: this.shown,
      onScreen: () => ({
        state: this.#closer ? this.#aids.drawable(this.#state) : this.#state,
        panes: this.#panes,
        surface: this.#surface,
        slices: this.#slices,
        closer: this.#closer,
        map: this.#map,
      }),
      actions: this.#actions(),
      announce: this.#host.announce,
      lookAtPanes: () => this.#lookAtPanes(),
      goTo: (depth_mm) => this.#goToDepth(depth_mm),
      made: this.#host.made,
      address: () => {
        this.#address.replace();
        return location.href;
      },
      measured: () => this.#showPoint(),
      reader: { get: () => this.#host.preferences().reader, set: (reader) => this.#host.choose({ reader }) },
      listed: (findings) => this.#aids.judged(findings),
      complain: (problem) => this.#notices.complain(problem),
    });
  }

  #surfacePane(): SurfacePane {
    const listener = {
      state: () => this.#state,
      hands: () => this.#host.preferences(),
      change: (change) => this.#change(change),
      command: (command) => this.command(command),
      pick: (place) => this.#pick(place),
      tool: () => this.#onDemand.tool,
      layer: (name) => this.#aids.voxels(name),
      noPart: (problem) => this.#showNoPart(problem),
      busy: (busy) => {
        this.#moving = busy;
        if (!busy) this.#schedule();
      },
      status: (status) => this.#onStatus(status),
    } satisfies SurfacePaneListener;
    return new SurfacePane(this.shown, this.#host.serverOnly, listener, this.#host.surface);
  }

  /** Undoes what was done last, to the view or to the findings, or does again what was undone last. */
  #goTo(which: "undo" | "redo"): void {
    const view_ms = this.#history.done_ms(this.#state, this.#changed_ms);
    const findings_ms = this.#onDemand.done_ms;
    const isOfFindings =
      which === "undo" ? findings_ms !== null && findings_ms >= (view_ms ?? 0) : this.#undone.at(-1) === "findings";
    if (isOfFindings && this.#onDemand.goTo(which)) {
      this.#hasGone(which, "findings");
      return this.#host.announce(t(`done.${which}`));
    }
    const state = this.#history[which](this.#state);
    if (state) this.#hasGone(which, "view");
    if (state) this.#take(state);
    this.#address.replace();
    this.#host.announce(t(state ? `done.${which}` : `none.${which}`));
  }

  #hasGone(which: "undo" | "redo", what: "view" | "findings"): void {
    if (which === "undo") this.#undone.push(what);
    else this.#undone.pop();
  }

  #take(state: ViewState): void {
    this.#stopSweep();
    this.#picked = null;
    this.#state = this.#aids.paired(state);
    this.#apply({});
  }

  #change(change: Change, step = false): void {
    if (step) {
      this.#history.record(this.#state, this.#changed_ms);
      this.#address.push();
    }
    this.#state = this.#aids.paired({ ...this.#state, ...change });
    this.#changed_ms = performance.now();
    if (step) this.#history.record(this.#state, this.#changed_ms);
    this.#apply(change);
    if (step) this.#address.replace();
  }

  /** Shows the state in the controls at once, and in the panes with the next frame. */
  #apply(change: Change): void {
    this.panel.point.across(this.#state.across_deg !== null && hasSlices(this.#state));
    for (const controls of [this.panel, this.#aids]) controls.show(this.#state);
    this.panel.showHistory(this.#history);
    this.#depthBar.show(this.#state.depth_mm, this.#sweep.isRunning);
    this.#panes.dispatchEvent(new CustomEvent("view", { detail: this.#state }));
    this.#onDemand.look(this.#state);
    this.#host.laid(this.#state);
    const isAll = Object.keys(change).length === 0;
    if (change.crosshair_mm !== undefined || change.depth_mm !== undefined || isAll) this.#showPoint();
    this.#schedule();
    this.element.dataset.rested = "false";
    this.#address.stir();
  }

  #onRest(): void {
    if (this.#sweep.isRunning) return;
    // A hand that pauses on its way through a slice makes no step of it.
    if (this.#panes.querySelector(":is(.slices, .closer):active")) return this.#address.stir();
    this.#unmoved = null;
    this.#address.replace();
    this.#history.record(this.#state, this.#changed_ms);
    this.panel.showHistory(this.#history);
    this.element.dataset.rested = "true";
    if (this.#explained && this.#state.depth_mm !== this.#explained.depth_mm) this.#dismissExplanation();
    const words = this.#speaker.say(this.#aids.drawable(this.#state), this.#surface);
    for (const pane of [this.#surface, this.#slices, this.#closer, this.#map]) pane?.describe(words);
  }

  /** Whoever has changed the depth knows how. */
  #dismissExplanation(): void {
    if (this.#host.preferences().knows_depth) return;
    this.#explained?.line.remove();
    this.#host.choose({ knows_depth: true });
  }

  #schedule(): void {
    this.#frame ||= requestAnimationFrame(() => {
      this.#frame = 0;
      if (this.#disposed) return;
      const state = this.#aids.drawable(this.#state);
      this.#surface.draw(state, this.#moving || this.#sweep.isRunning);
      if (hasSlices(state)) this.#slices.show(state);
      for (const shown of [this.#showCloser(state), this.#showMap(state)])
        shown.catch((problem: unknown) => this.#notices.complain(problem));
    });
  }

  #onStatus({ way, fallback, trouble }: SurfaceStatus): void {
    for (const { element } of [this, this.panel]) element.dataset.way = way;
    this.element.dataset.fallback = fallback ?? "";
    this.#notices.fallback(fallback);
    this.#notices.trouble(trouble);
    if (!this.#disposed) this.#schedule();
    this.#onDemand?.surfaceKnown();
    this.#settle();
    // Below its deepest place a part shows nothing.
    const deepest_mm = this.#surface?.surface.deepest_mm ?? null;
    if (deepest_mm !== null && this.#state.depth_mm > deepest_mm) {
      this.#change({ depth_mm: Math.floor(deepest_mm * 100) / 100 });
    }
    // More may be known of the point than when it was marked.
    const { crosshair_mm } = this.#state;
    if (crosshair_mm && this.element.dataset.loaded) this.#tellPoint(crosshair_mm);
  }

  /** Brings the place that waits for a half to its depth there. */
  #settle(): void {
    const { crosshair_mm, surface, layout } = this.#state;
    if (!this.#awaited || crosshair_mm !== this.#awaited.position || !isHalf(surface))
      return void (this.#awaited = null);
    if (this.#surface.surface.pointsOf(surface)) this.#bringInside({ ...this.#awaited, half: surface }, layout, false);
  }

  #stopSweep(): void {
    if (this.#sweep.stop()) this.#apply({});
  }

  /** Shows the whole brain in the place of a part that cannot be shown, and says why. */
  #showNoPart(problem: unknown): void {
    const words = problemWords(problem);
    if (problem instanceof Problem && problem.kind === "no-surfaces") this.panel.refuseParts(words);
    this.#notices.remark(words);
    this.#host.announce(words);
    const awaited = this.#awaited;
    this.#awaited = null;
    if (awaited && awaited.position === this.#state.crosshair_mm)
      return this.#change({ ...broughtTo(awaited.position, awaited.depth_mm, "slices", this.shown), surface: "whole" });
    if (this.#state.surface !== "whole") this.#change({ surface: "whole" });
  }

  /** Puts the cross where the surface is seen at a place of the pane. */
  #pick(place: Vec2, state: ViewState = this.#state): void {
    const picked = this.#surface.pick(place, state);
    if (!picked) {
      // Until the depths are here nothing knows where the surface is.
      const isLoading = this.element.dataset.loaded === undefined;
      if (isLoading && !this.#surface.knowsSurface) this.#wanted = { place, state };
      const untold = isLoading ? "point.loading" : "point.unknown";
      return this.#tellMissed(this.#surface.knowsSurface ? "point.none" : untold);
    }
    this.#picked = picked;
    // The marked hemisphere is the one that is shown as it was acquired.
    const view = picked.isFlipped ? otherSide(state, this.shown) : {};
    this.#change({ ...view, crosshair_mm: picked.position_in_patient }, true);
    this.#host.announce(t("point.said", { position: positionWords(picked.position_in_patient) }));
  }

  /** Says why nothing was marked. */
  #tellMissed(why: Key): void {
    this.panel.point.hint(t(why));
    this.#host.announce(t(why));
  }

  /** Puts the cross where a slice was touched; the surface turns to it when the hand has left. */
  #moveCross(position: Vec3, done: boolean): void {
    this.#picked = null;
    this.#unmoved ??= this.#state;
    if (done) {
      this.#unclicked = [this.#unclicked[1], this.#unmoved];
      [this.#state, this.#unmoved] = [this.#unmoved, null];
    }
    this.#change({ crosshair_mm: position, ...(done ? turnedTo(position, this.shown) : {}) }, done);
  }

  /** Brings a place to the viewer, on the part that is shown if it lies there, else on the whole brain. */
  #bring(position: Vec3, depth_mm: number | null, layout: Layout): void {
    this.#stopSweep();
    if (depth_mm === null) return this.#bringSlices(position, layout);
    // The depth of a finding may be that below a half.
    const whole_mm = this.#surface.surface.wholeDepth(position) ?? depth_mm;
    const half = layout === "map" ? null : innerSideOf(position, whole_mm, this.shown);
    if (half) return this.#bringInside({ position, depth_mm: whole_mm, half }, layout, true);
    this.#awaited = null;
    const isDeep = whole_mm > DEEP_MM;
    // A part that is still being fetched is drawn once the place is shown.
    const isPart = this.#surface.surface.deepest_mm !== null;
    const own_mm = isPart ? (this.#surface.probe(position)?.depth_mm ?? NaN) : depth_mm;
    const at = broughtTo(position, own_mm >= 0 ? own_mm : depth_mm, layout, this.shown);
    const slices = isDeep && !hasSlices({ layout }) && layout !== "closer" && layout !== "map";
    const beside = slices ? ({ layout: layout === "mirror" ? "both" : "slices" } as const) : {};
    this.#change({ ...at, ...(own_mm >= 0 ? {} : { surface: "whole" }), ...beside }, true);
    if (isDeep) this.#host.announce(t("point.deep"));
  }

  /** Shows a place whose depth is not known, at the depth that is shown. */
  #bringSlices(position: Vec3, layout: Layout): void {
    this.#awaited = null;
    const shownIn = hasSlices({ layout }) || layout === "closer" ? layout : "slices";
    this.#change(broughtTo(position, this.#state.depth_mm, shownIn, this.shown), true);
    this.#host.announce(t("point.cut"));
  }

  /** Shows a place on the inner side of a half, at once at about its depth, and at its depth as soon as the half is here. */
  #bringInside(
    { position, depth_mm, half }: { position: Vec3; depth_mm: number; half: "left" | "right" },
    layout: Layout,
    isStep: boolean,
  ): void {
    const own_mm = this.#surface.surface.pointsOf(half)?.probe(position).depth_mm;
    // It is not of the half after all.
    if (own_mm !== undefined && !(own_mm >= 0)) {
      this.#awaited = null;
      const at = broughtTo(position, depth_mm, hasSlices({ layout }) ? layout : "slices", this.shown);
      this.#change({ ...at, surface: "whole" }, isStep);
      return this.#host.announce(t("point.deep"));
    }
    this.#awaited = own_mm === undefined ? { position, depth_mm } : null;
    const from_plane_mm = Math.abs(distance_mm(position, mirrorPlane(this.shown)));
    const { zoom } = this.#state;
    const place = { position, half, depth_mm: own_mm ?? from_plane_mm };
    this.#change(broughtInside(place, { zoom, layout }, this.shown), isStep);
    if (isStep) this.#host.announce(t(half === "left" ? "point.inner-left" : "point.inner-right"));
  }

  #goToDepth(depth_mm: number): void {
    this.#change({ depth_mm: clampDepth(depth_mm, this.shown) }, true);
  }

  #showPoint(): void {
    const position = this.#state.crosshair_mm;
    if (!position) return this.panel.point.show(null);
    this.#tellPoint(position);
    void this.#showProfile(position);
  }

  #tellPoint(position: Vec3): void {
    const known: Partial<Picked> = this.#picked ?? this.#surface.probe(position) ?? {};
    this.panel.point.show(pointWords(this.shown, position, known, this.#valuesAt(position, known.intensity)));
    // Of a half, the inner side has it.
    const { surface } = this.#state;
    if (!isHalf(surface) && (this.#surface.surface.wholeDepth(position) ?? 0) > DEEP_MM)
      this.panel.point.hint(t("point.deep"));
  }

  /** The intensities at a position, of all volumes that are shown, in words. */
  #valuesAt(position: Vec3, grey = this.#surface.probe(position)?.intensity ?? null): string {
    return valueWords(grey, this.#aids.valuesAt(position));
  }

  /** Plots intensity against depth below a position, where it is known by then and still the marked one. */
  async #showProfile(position: Vec3): Promise<void> {
    const profile = this.#surface.surface.profile(position);
    const plotted = profile && (await this.#onDemand.plot(profile, position));
    if (!this.#disposed && this.#state.crosshair_mm === position) this.panel.point.plot(plotted);
  }

  #actions(): Actions {
    return {
      change: (change, step) => {
        this.#stopSweep();
        this.#change(change, step);
      },
      command: (command) => this.command(command),
      bring: (position, depth_mm, layout) => {
        this.#bring(position, depth_mm, layout ?? this.#state.layout);
        if (layout) this.#lookAtPanes();
      },
      turnToCross: () => {
        if (this.#state.crosshair_mm) this.#change(turnedTo(this.#state.crosshair_mm, this.shown), true);
      },
      forgetCross: () => {
        this.#picked = null;
        this.#change({ crosshair_mm: null }, true);
      },
      depthOfCross: () => {
        const { crosshair_mm } = this.#state;
        const { depth_mm = -1 } = (crosshair_mm && this.#surface.probe(crosshair_mm)) ?? {};
        if (depth_mm >= 0) this.#goToDepth(depth_mm);
      },
    };
  }
}
