// Which layers are shown, what is known of them, and how the picture with them is compared with the picture without.

import { type ReadonlySignal, computed, effect, signal, untracked } from "@preact/signals";

import { type NamedValue, paneWords } from "../base/readout.ts";
import { t } from "../base/i18n.ts";
import type { LayerCommand } from "../model/controls.ts";
import {
  type Layer,
  type LayerList,
  greyOf,
  isAdded,
  isReady,
  nextOf,
  overlayOf,
  styleOfLayer,
} from "../model/layers.ts";
import { type LayerOverlay, MAP_NAMES, firstOverlay, isLayerId, isMap, styleOfMap, toggled } from "../model/maps.ts";
import {
  type HalfLook,
  type Layout,
  type PaneLook,
  type Place,
  type Slot,
  type ViewState,
  allLayersOf,
  bareOf,
  halfOf,
  hasSlices,
  isMirrored,
  lookAt,
  placeOf,
  seenOf,
  withLook,
} from "../model/state.ts";
import type { Affine, Vec3 } from "../model/space.ts";
import { note } from "./announce.ts";
import type { CaseLayers } from "./case-layers.ts";
import type { View } from "./view.ts";

/** Twice a second there, twice away. */
const BLINK_MS = 250;

export class ShownLayers {
  /** The state as it is drawn: without what is hidden for now or not ready, and with what is known of the rest. */
  readonly drawn: ReadonlySignal<ViewState>;
  /** Whether the layers are hidden for now. */
  readonly isHidden = signal(false);
  readonly isBlinking = signal(false);
  /** The added layer that is shown, which can be moved by hand. */
  readonly shownId: ReadonlySignal<string | null>;
  /** How the layer was moved by hand, as long as it is not added as another one. */
  readonly moved = signal<Affine | null>(null);
  /** Counts how often a key asked to move the layer by hand. */
  readonly nudges = signal(0);
  /** Files that were dropped on the case, or on the form where they are described, to be added to it. */
  readonly dropped = signal<{ readonly files: readonly File[]; readonly isOnForm: boolean } | null>(null);
  /** What became of a layer. */
  readonly said = signal("");
  readonly #view: View;
  readonly #layers: CaseLayers;
  readonly #complain: (problem: unknown) => void;
  /** What a key wanted to see before the layers were listed. */
  #wanted: "grey" | "colours" | null = null;
  #movedId: string | null = null;
  /** The layout from which two halves with layers of their own were opened. */
  #beforeBeside: Layout | null = null;
  #timer = 0;
  readonly #ends: readonly (() => void)[];

  constructor(view: View, layers: CaseLayers, complain: (problem: unknown) => void) {
    this.#view = view;
    this.#layers = layers;
    this.#complain = complain;
    this.drawn = computed(() => this.#drawnOf(view.state.value));
    this.shownId = computed(() => {
      const before = this.#movedId;
      // What was moved stays so in whichever pane the hand is.
      if (this.moved.value && before && allLayersOf(view.state.value).includes(before)) return before;
      const ids = [view.seen.value, view.state.value].map(
        ({ layer, overlay }) => layer?.id ?? (overlay && isLayerId(overlay.name) ? overlay.name : null),
      );
      return ids.find((id) => id !== null) ?? null;
    });
    const names = computed(() => allLayersOf(view.state.value).join());
    const isShown = computed(() => {
      const { beside } = view.state.value;
      return beside !== null || allLayersOf(view.state.value).length > 0;
    });
    this.#ends = [
      effect(() => {
        if (names.value !== "" && !layers.list.value) untracked(() => this.#ask());
      }),
      effect(() => this.#settle(view.state.value, layers.list.value)),
      effect(() => {
        if (!isShown.value) untracked(() => this.stopBlinking());
      }),
      // Another layer lies where the server has it.
      effect(() => {
        if (this.shownId.value !== this.#movedId) this.moved.value = null;
        this.#movedId = this.shownId.value;
      }),
    ];
  }

  dispose(): void {
    this.stopBlinking();
    for (const end of this.#ends) end();
  }

  /** Shows a layer that is ready as the texture; null: the case's own intensities. */
  grey(id: string | null): void {
    const change = this.asGrey(id, this.#view.seen.peek());
    if (change) this.#view.changeLook(change, true);
  }

  /** The change to a layer as the texture, with the window that it was left with; null if it is not ready. */
  asGrey(id: string | null, before: HalfLook = this.#view.now): Pick<HalfLook, "layer" | "window"> | null {
    const found = id === null ? null : this.#layers.ready(id);
    const layer = (found && greyOf(found)) ?? null;
    if (id !== null && !layer) return null;
    const { windows, shown } = this.#view;
    windows.set(before.layer?.id ?? "", before.window);
    return { layer, window: windows.get(id ?? "") ?? (layer ?? shown).intensity.window };
  }

  /** Shows a layer that is ready in colours, alone, or hides it again; null: none. */
  colours(id: string | null): void {
    const found = id === null ? null : this.#layers.ready(id);
    if (id !== null && !found) return;
    const { overlay } = this.#view.seen.peek();
    this.#view.changeLook({ overlay: found ? toggled(overlay, overlayOf(found)) : null }, true);
  }

  /** What can be shown in a pane: the case itself, which has no id, then what was added, then the maps. */
  get series(): readonly Series[] {
    const ready = this.#layers.list.value?.layers.filter(isReady) ?? [];
    const maps = MAP_NAMES.filter((name) => ready.some(({ id }) => id === name));
    return [
      { id: "", name: t("value.own") },
      ...ready.filter(isAdded).map(({ id, name }) => ({ id, name })),
      ...maps.map((id) => ({ id, name: t(`map.${id}`) })),
    ];
  }

  /** Shows a series in a pane, or in all panes without one of their own; the others stay as they are. */
  showSeries(id: string, pane: Place | null): void {
    const { now } = this.#view;
    const place = placeOf(now, pane);
    const before = lookAt(now, place);
    const look = this.#lookOf(id, before);
    const name = this.series.find((one) => one.id === id)?.name;
    if (!look || name === undefined) return note(t("layers.none-ready"));
    const change = withLook(now, place, look);
    if (!this.#view.change({ ...change, ...(place !== "left" && { swipe: null }) }, true)) return;
    note(t("strip.said", { name, pane: paneWords(now, place) }));
  }

  /** Shows the next of what can be shown in a pane. */
  nextSeries(pane: Place | null): void {
    const ids = this.series.map(({ id }) => id);
    const shown = seriesOf(lookAt(this.#view.now, placeOf(this.#view.now, pane)));
    if (ids.length < 2) return note(t("layers.none-ready"));
    this.showSeries(nextOf(ids, shown) ?? "", pane);
  }

  /** Shows the same in all panes. */
  alike(): void {
    this.#view.change({ panes: {} }, true);
    note(t("strip.alike-said"));
  }

  /** How a series is shown at first, or as it was left, in the place of another one; null if it is not ready. */
  #lookOf(id: string, before: HalfLook): HalfLook | null {
    const { now, windows, shown } = this.#view;
    for (const { layer, window } of [before, now]) windows.set(layer?.id ?? "", window);
    const found = id === "" ? null : this.#layers.ready(id);
    if (id !== "" && !found) return null;
    const layer = (found && !isMap(id) && greyOf(found)) || null;
    const overlay = !found || layer ? null : isMap(id) ? firstOverlay(id) : overlayOf(found);
    const window = windows.get(layer?.id ?? "") ?? (layer ?? shown).intensity.window;
    return { layer, overlay, window, colormap: now.colormap };
  }

  /** The values at a position of the layers that are shown, as far as their voxels are here. */
  valuesAt(position: Vec3): readonly NamedValue[] {
    const isHere = this.#layers.here.value;
    const shown = seenOf(this.drawn.value).flatMap(({ layer, overlay }) => [
      ...(layer ? [{ id: layer.id, name: layer.about?.title ?? "", moved: layer.moved }] : []),
      ...(overlay ? [{ id: overlay.name, name: overlayName(overlay), moved: overlay.moved }] : []),
    ]);
    const each = new Map(shown.map((one) => [one.id, one]));
    return [...each.values()].flatMap(({ id, name, moved }) => {
      const value = !moved && isHere.has(id) ? this.#layers.valueAt(id, position) : undefined;
      return value !== undefined ? [{ name, value }] : [];
    });
  }

  command({ kind }: LayerCommand): void {
    const { now } = this.#view;
    const isCloser = now.layout === "closer";
    if (kind === "grey" || kind === "colours") return this.#next(kind);
    if (!now.beside && allLayersOf(now).length === 0) return note(t("layers.none-shown"));
    switch (kind) {
      case "nudge":
        return void (this.nudges.value += 1);
      case "swipe":
        // A close-up has its halves already.
        if (!isCloser) this.#view.change({ swipe: now.swipe ? null : { share: 0.5 }, beside: null }, true);
        return;
      case "edges": {
        const layout = isMirrored(now) ? "both" : "slices";
        const needsSlices = !now.has_edges && !hasSlices(now) && !isCloser;
        return void this.#view.change({ has_edges: !now.has_edges, ...(needsSlices && { layout }) }, true);
      }
      case "beside": {
        if (isCloser) return;
        // A mirrored half gives way, and comes back.
        if (now.beside) return void this.#view.change({ beside: null, layout: this.#beforeBeside ?? now.layout }, true);
        const layout = hasSlices(now) ? "slices" : "single";
        this.#beforeBeside = now.layout;
        return void this.#view.change({ beside: this.#view.own(now), layout, swipe: null }, true);
      }
      case "swap":
        // What is chosen is of the right half, which the surface may have of its own.
        if (now.beside && !isCloser) {
          const right = now.panes.surface ? "surface" : "all";
          this.#view.change({ ...withLook(now, right, now.beside), beside: lookAt(now, right) }, true);
        }
        return;
    }
  }

  hide(isHidden: boolean): void {
    this.isHidden.value = isHidden;
  }

  /** Shows and hides the layers in turn, or no more. */
  blink(): void {
    if (this.isBlinking.peek()) return this.stopBlinking();
    this.isBlinking.value = true;
    this.#timer = window.setInterval(() => (this.isHidden.value = !this.isHidden.peek()), BLINK_MS);
  }

  stopBlinking(): void {
    clearInterval(this.#timer);
    this.isBlinking.value = false;
    this.isHidden.value = false;
  }

  /** Shows the next of the added layers, or none after the last, once they are listed. */
  #next(how: "grey" | "colours"): void {
    const list = this.#layers.list.peek();
    if (!list) {
      this.#wanted = how;
      return this.#ask();
    }
    const seen = this.#view.seen.peek();
    const ready = list.layers.filter((layer) => isAdded(layer) && isReady(layer));
    const usable = how === "grey" ? ready.filter((layer) => greyOf(layer)) : ready;
    if (usable.length === 0) return note(t("layers.none-ready"));
    const shown = how === "grey" ? seen.layer?.id : seen.overlay?.name;
    const ids = usable.map(({ id }) => id);
    const id = nextOf(ids, shown !== undefined && ids.includes(shown) ? shown : null);
    if (how === "grey") this.grey(id);
    else this.colours(id);
  }

  #ask(): void {
    this.#layers.ask().catch(this.#complain);
  }

  // -- What is drawn

  #drawnOf(state: ViewState): ViewState {
    const slots = Object.entries(state.panes) as [Slot, PaneLook][];
    const panes = slots.map(([slot, own]) => {
      const { bare_window, swipe, has_edges, ...rest } = this.#drawnPane({ ...state, ...own, beside: null });
      return [slot, { ...halfOf(rest), bare_window, swipe, has_edges }];
    });
    return { ...this.#drawnPane(state), ...(slots.length > 0 && { panes: Object.fromEntries(panes) }) };
  }

  #drawnPane(state: ViewState): ViewState {
    const { beside } = state;
    const right = this.#known(state);
    const drawn = this.#placed(beside ? { ...right, beside: this.#known(beside), swipe: null } : right);
    if (!drawn.layer && !drawn.overlay)
      return drawn.swipe || drawn.has_edges ? { ...drawn, swipe: null, has_edges: false } : drawn;
    const isHidden = this.isHidden.value;
    if (!isHidden && !drawn.swipe && !drawn.has_edges) return drawn;
    const both = { ...drawn, bare_window: this.#view.own(drawn).window };
    return isHidden ? bareOf(both) : both;
  }

  /** Without a layer that is not ready, and with what is known of the others. */
  #known<State extends HalfLook>(state: State): State {
    if (!state.overlay && !state.layer) return state;
    const overlay = state.overlay && this.#overlayOf(state.overlay);
    const found = state.layer && this.#layers.ready(state.layer.id);
    const grey = found && greyOf(found);
    if (!state.layer) return { ...state, overlay };
    if (found && grey) return { ...state, overlay, layer: { ...grey, ...aboutOf(found) } };
    return { ...state, overlay, layer: null, window: this.#view.shown.intensity.window };
  }

  #overlayOf(overlay: LayerOverlay): LayerOverlay | null {
    const found = this.#layers.ready(overlay.name);
    if (!found) return null;
    return isMap(overlay.name) ? overlay : { ...overlay, about: { ...styleOfLayer(found), ...aboutOf(found).about } };
  }

  /** A state with its layer where it was moved to. */
  #placed(state: ViewState): ViewState {
    const moved = this.moved.value;
    const { layer, overlay } = state;
    if (!moved || this.shownId.value !== (layer?.id ?? overlay?.name)) return state;
    const origin = t("nudge.origin");
    if (layer) return { ...state, layer: { ...layer, moved, about: { title: "", ...layer.about, origin } } };
    return overlay?.about ? { ...state, overlay: { ...overlay, moved, about: { ...overlay.about, origin } } } : state;
  }

  // -- What the list says

  /** Takes over what the list says of the layers of the state; those that are gone are not shown. */
  #settle(state: ViewState, list: LayerList | null): void {
    if (!list) return;
    untracked(() => {
      const right = this.#settled(state, list);
      const left = state.beside && this.#settled(state.beside, list);
      const panes = Object.entries(state.panes).map(([slot, own]) => [slot, this.#settled(own, list) ?? own]);
      const isNew = panes.some(([slot, own]) => state.panes[slot as Slot] !== own);
      if (right || left || isNew)
        this.#view.change({
          ...right,
          ...(left && { beside: left }),
          ...(isNew && { panes: Object.fromEntries(panes) }),
        });
      const wanted = this.#wanted;
      this.#wanted = null;
      if (wanted) this.#next(wanted);
    });
  }

  /** What a half shows by the list; null: it stays as it is. */
  #settled(half: HalfLook, { layers }: LayerList): HalfLook | null {
    const isGone = (id: string | undefined): boolean =>
      id !== undefined && (isLayerId(id) || id === "flair") && !layers.some((one) => one.id === id);
    const { window } = this.#view.shown.intensity;
    const [isBare, isPlain] = [isGone(half.layer?.id), isGone(half.overlay?.name)];
    if (isBare || isPlain) {
      this.said.value = t("problem.no-such-layer");
      return { ...halfOf(half), ...(isBare && { layer: null, window }), ...(isPlain && { overlay: null }) };
    }
    const found = half.layer && !half.layer.intensity && this.#layers.ready(half.layer.id);
    const layer = found && greyOf(found);
    if (!layer) return null;
    // An address that names a layer and no window means the layer's own.
    const isUnsaid = half.window.center === window.center && half.window.width === window.width;
    return { ...halfOf(half), layer, ...(isUnsaid && { window: layer.intensity.window }) };
  }
}

/** What can be shown in a pane. */
export interface Series {
  /** The name of a map or the id of a layer; empty: the case itself. */
  readonly id: string;
  readonly name: string;
}

/** The series that a look shows. */
export const seriesOf = ({ layer, overlay }: HalfLook): string => layer?.id ?? overlay?.name ?? "";

/** What a layer over the picture is called beside its values. */
const overlayName = ({ name, about }: LayerOverlay): string => {
  if (!isMap(name)) return about?.title ?? "";
  // A place of the list has a score of its own.
  return styleOfMap(name).unit === "z" ? t("value.map", { name: t(`map.${name}`) }) : t(`map.${name}`);
};

/** What stands on a picture about a layer that is ready. */
const aboutOf = ({ name, origin, quality }: Layer) => {
  const placed = origin ? t(`origin.${origin}`) : "";
  return { about: { title: name, origin: quality === "review" ? t("origin.review", { origin: placed }) : placed } };
};
