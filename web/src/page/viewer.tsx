// The chosen case: the panes that draw its store, and the controls around them.

import { effect, untracked } from "@preact/signals";
import { type ComponentChildren, render } from "preact";

import type { ReadyCase } from "../model/case.ts";
import type { Change } from "../model/controls.ts";
import { type OfCase, readState, writeAddress } from "../model/fragment.ts";
import type { Left } from "../model/memory.ts";
import { type Place, type ViewState, hasSlices, placeOf, slotsOf, stateIn } from "../model/state.ts";
import { h } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { pacsOf, patientWords } from "../base/pacs.ts";
import { Closer } from "../panes/closer.ts";
import { MapPane } from "../panes/flat-map.ts";
import { SliceGroup } from "../panes/slice-group.ts";
import { SurfacePane } from "../panes/surface-pane.ts";
import { announce } from "../store/announce.ts";
import { goToRow, settle } from "../store/bring.ts";
import { catchUp } from "../store/commands.ts";
import { Store } from "../store/store.ts";
import type { SharedVolume } from "../store/surface.ts";
import { DepthBar, Explanation } from "./depth-bar.tsx";
import type { OnScreen } from "./export.ts";
import { LoadingLine, Note, Notices, unreadWords } from "./notices.tsx";
import { spokenWords } from "./spoken.ts";
import { SeriesStrip, hearSeries } from "./series-strip.tsx";
import { Tools } from "./tools.tsx";

/** How long the state rests before the address follows it and the depth is read out. */
const REST_MS = 350;

export interface Opening {
  readonly rest: string;
  /** The finding to go to; empty: none. */
  readonly finding: string;
  readonly left: Left;
  /** Whether the server alone draws. */
  readonly serverOnly: boolean;
  /** What the file holds in which the case is looked at; null: there is a server. */
  readonly shared: SharedVolume | null;
  /** What of a state can be shown; absent: all of it. */
  readonly keep?: (state: ViewState) => ViewState;
}

export class Viewer {
  readonly element: HTMLElement;
  readonly store: Store;
  readonly #panes: HTMLElement;
  readonly #surface: SurfacePane;
  readonly #slices: SliceGroup;
  /** The close-up and the flat map, while they are shown. */
  #closer: Closer | null = null;
  #map: MapPane | null = null;
  readonly #observer = new ResizeObserver(() => this.#schedule());
  readonly #hosts: HTMLElement[] = [];
  readonly #ends: readonly (() => void)[];
  #loadAbort = new AbortController();
  #frame = 0;
  #rest = 0;
  /** What was read out last; null before the first picture. */
  #said: string | null = null;
  #isDisposed = false;
  #finding: string;
  readonly #isShared: boolean;
  readonly #keep: (state: ViewState) => ViewState;

  constructor(shown: ReadyCase, { rest, finding, left, serverOnly, shared, keep = (state) => state }: Opening) {
    // An address that says something says all; one that names the case alone leaves it as it was.
    const isAsLeft = rest === "" || `#${shown.id}&${rest}` === writeAddress(left.state, shown);
    const { state, unread } = isAsLeft ? { state: left.state, unread: [] } : readState(rest, shown);
    const store = (this.store = new Store(shown, keep(state), left.history));
    store.remark.value = unreadWords(unread);
    this.#finding = finding;
    this.#surface = new SurfacePane(store, { serverOnly, shared });
    this.#isShared = shared !== null;
    this.#keep = keep;
    this.#slices = new SliceGroup(store, () => this.#schedule());
    this.#panes = h(
      "div",
      {
        class: "panes",
        swipe: ({ detail }: CustomEvent<number>) => store.view.change({ swipe: { share: detail } }),
        follow: ({ detail }: CustomEvent<Change>) => store.change(detail),
      },
      h("div", { class: "flat-map" }),
      this.#surface.element,
      this.#slices.element,
      h("div", { class: "closer" }),
      this.#mounted(
        <>
          <LoadingLine store={store} cancel={() => this.#loadAbort.abort()} again={() => void this.load()} />
          <Note />
        </>,
      ),
    );
    this.element = h(
      "div",
      { class: "viewer" },
      shared
        ? null
        : this.#mounted(
            <>
              <Tools store={store} onScreen={() => this.onScreen} />
              <SeriesStrip store={store} />
            </>,
          ),
      this.#mounted(<Notices store={store} isShared={shared !== null} />),
      this.#panes,
      this.#mounted(<Explanation />),
      this.#mounted(<DepthBar store={store} />),
    );
    for (const { element } of [this.#surface, this.#slices]) this.#observer.observe(element);
    this.#ends = this.#follow();
  }

  /** Begins to fetch what the surface draws with; the element is in the page by now. */
  async load(): Promise<void> {
    const { store } = this;
    this.#loadAbort = new AbortController();
    store.loading.value = "begun";
    // No picture is seen before its patient.
    void this.#meetPacs();
    try {
      await this.#surface.surface.load(this.#loadAbort.signal, (progress) => (store.loading.value = progress));
      store.loading.value = null;
    } catch (error) {
      store.loading.value = null;
      if (this.#isDisposed) return;
      if (this.#loadAbort.signal.aborted) {
        store.loading.value = "cancelled";
        announce(t("load.cancelled"));
      } else store.complain(error);
    }
    if (this.#isDisposed) return;
    this.element.dataset.loaded = "true";
    store.isLoaded.value = true;
    store.meet(this.#surface.surface);
    void this.#readFindings();
    if (!this.#isShared) void store.caseLayers.follow();
    catchUp(store);
    this.#schedule();
  }

  /** Shows what the address says, which Back has changed, or a hand. */
  restore({ rest, finding }: OfCase): void {
    const { state, unread } = readState(
      rest,
      this.store.shown,
      rest === "" && finding ? this.store.view.now : undefined,
    );
    this.store.take(this.#keep(state));
    this.store.remark.value = unreadWords(unread);
    this.#finding = finding;
    if (finding && this.store.isLoaded.peek()) void this.#readFindings();
  }

  /** Reads what is stored, and goes to the finding that the address names. */
  async #readFindings(): Promise<void> {
    const { store } = this;
    const isRead = await store.findings.sync.load();
    const id = this.#finding;
    if (!id || !isRead || store.isOver) return;
    this.#finding = "";
    const row = store.rows.all.peek().find(({ finding }) => finding?.id === id);
    store.task.value = "read";
    if (row) goToRow(store, row);
    else store.remark.value = t("address.no-finding");
  }

  /** Failed requests are repeated. */
  again(): void {
    this.store.trouble.value = "";
    if (this.#finding !== "") void this.#readFindings();
    this.#schedule();
  }

  dispose(): void {
    this.#isDisposed = true;
    for (const end of this.#ends) end();
    document.body.classList.remove("alone");
    for (const host of this.#hosts) render(null, host);
    clearTimeout(this.#rest);
    cancelAnimationFrame(this.#frame);
    this.#loadAbort.abort();
    this.#observer.disconnect();
    this.store.dispose();
    for (const part of [this.#slices, this.#closer, this.#map]) part?.dispose();
    this.#surface.surface.dispose();
    this.element.remove();
  }

  /** The panes draw what the store says. */
  #follow(): readonly (() => void)[] {
    const { store } = this;
    const { view } = store;
    return [
      ...hearSeries(this.#panes, store, (pane, event) => this.#placeAt(pane, event)),
      effect(() => {
        // The pane that controls are about, where there are several.
        const place = placeOf(view.state.value, view.pane.value);
        this.#panes.dataset.pane = store.isStripShown.value ? place : "";
      }),
      effect(() => {
        this.#panes.dispatchEvent(new CustomEvent("view", { detail: view.state.value }));
        // What a sweep has come to rests when it is stopped.
        void store.sweep.isRunning.value;
        store.isResting.value = false;
        this.#stir();
      }),
      effect(() => void (this.element.dataset.rested = String(store.isResting.value))),
      effect(() => {
        // Whatever of these changes, the panes draw again.
        void [store.drawn.value, view.state.value, store.isMoving.value, store.sweep.isRunning.value];
        void [store.status.value, store.large.value];
        this.#schedule();
      }),
      effect(() => {
        this.#surface.surface.showTimer(store.hasTimer.value);
        this.#schedule();
      }),
      effect(() => {
        const { way, fallback } = store.status.value ?? {};
        Object.assign(this.element.dataset, { way, fallback: fallback ?? "" });
        untracked(() => settle(store));
      }),
      effect(() => {
        for (const pane of this.#all) pane.mark(store.marked.value);
      }),
      effect(() => {
        const isBare = store.isBare.value;
        const { slices, closer } = store.outlined.value;
        this.#slices.outline(slices && !isBare);
        this.#closer?.outline(closer && !isBare);
        Object.assign(this.#panes.dataset, { bare: isBare, outlined: slices, moves: store.moves.value });
      }),
      effect(() => void document.body.classList.toggle("alone", store.isAlone.value)),
      effect(() => {
        if (store.centred.value > 0) for (const pane of [this.#slices, this.#closer]) pane?.center();
      }),
      effect(() => {
        // Where the controls lie below the panes, scrolls to the panes.
        if (store.looks.value > 0) this.element.scrollIntoView({ block: "start" });
      }),
    ];
  }

  /** Whose look is seen in a pane, where an event is. */
  #placeAt(pane: HTMLElement, event: Event): Place {
    const place = (pane.dataset.pane ?? "all") as Place;
    if (place !== "surface" || !(event instanceof MouseEvent)) return place;
    const { left, top } = pane.getBoundingClientRect();
    return this.#surface.paneAt([event.clientX - left, event.clientY - top]);
  }

  /** Components among the elements of the viewer. */
  #mounted(components: ComponentChildren): HTMLElement {
    const host = h("div", { class: "mounted" });
    render(components, host);
    this.#hosts.push(host);
    return host;
  }

  get #all() {
    return [this.#surface, this.#slices, this.#closer, this.#map].filter((pane) => pane !== null);
  }

  #schedule(): void {
    this.#frame ||= requestAnimationFrame(() => {
      this.#frame = 0;
      if (!this.#isDisposed) this.#draw();
    });
  }

  #draw(): void {
    const { store } = this;
    const state = store.drawn.peek();
    this.#surface.draw(state, store.isMoving.peek() || store.sweep.isRunning.peek());
    // Nobody else draws the slices of a file.
    if (hasSlices(state) && (!this.#isShared || store.status.peek()?.canSlice)) this.#slices.show(state);
    if (state.layout !== "closer") {
      this.#closer?.dispose();
      this.#closer = null;
    } else {
      this.#closer ??= this.#join(new Closer(store), ".closer");
      this.#closer.show(state);
    }
    if (state.layout !== "map") {
      this.#map?.element.replaceWith(h("div", { class: "flat-map" }));
      this.#map?.dispose();
      this.#map = null;
    } else {
      this.#map ??= this.#join(new MapPane(store), ".flat-map");
      this.#panes.dataset.inner = String(state.map.has_inner);
      this.#map.show(state);
    }
  }

  /** Puts a new pane into its place. */
  #join<Pane extends Closer | MapPane>(pane: Pane, place: string): Pane {
    pane.mark(this.store.marked.peek());
    if (pane instanceof Closer) pane.outline(this.store.outlined.peek().closer && !this.store.isBare.peek());
    this.#panes.querySelector(place)?.replaceWith(pane.element);
    this.#observer.observe(pane.element);
    return pane;
  }

  #stir(): void {
    clearTimeout(this.#rest);
    this.#rest = window.setTimeout(() => this.#onRest(), REST_MS);
  }

  #onRest(): void {
    const { store } = this;
    if (store.sweep.isRunning.peek()) return;
    // A hand that pauses on its way through a slice makes no step of it.
    if (this.#panes.querySelector(":is(.slices, .closer):active")) return this.#stir();
    store.rest();
    const words = spokenWords(store);
    // What is new is read out; at first the page has enough to say.
    if (this.#said !== null && this.#said !== words) announce(words);
    this.#said = words;
    for (const pane of this.#all) pane.describe(words);
  }

  get onScreen(): OnScreen {
    const { store } = this;
    // A layer that is being fetched is not on the screen; in a close-up the surface is not.
    const drawn = store.drawn.peek();
    const { layers } = this.#surface;
    // A surface with its own series does not say what the others show.
    const each = Object.fromEntries(slotsOf(drawn).map((slot) => [slot, stateIn(drawn, slot)]));
    const panes = drawn.panes.surface ? { ...each, surface: layers } : drawn.panes;
    const state = this.#closer ? drawn : { ...store.view.now, panes, ...layers };
    return {
      shown: store.shown,
      state,
      panes: this.#panes,
      surface: this.#surface,
      slices: this.#slices,
      closer: this.#closer,
      map: this.#map,
    };
  }

  /** Asks once whose head it is, and to which nodes results can be sent. Until then, pictures are hidden. */
  async #meetPacs(): Promise<void> {
    const { store } = this;
    const { dataset } = this.element;
    if (!store.shown.links?.dicom || dataset.patient) return;
    dataset.patient = "awaited";
    store.patient.value = await patientWords(store.shown).catch(() => "");
    store.nodes.value = await pacsOf().then(
      ({ nodes }) => nodes,
      () => [],
    );
    dataset.patient = "met";
  }
}
