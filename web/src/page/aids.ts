// The layers over the pictures, the maps among them: two sections of the panel, which are filled when they are first
// wanted, and what the panes draw.

import { quiet } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import type { ReadyCase, Window } from "../model/case.ts";
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
import type { Command, LayerCommand } from "../model/controls.ts";
import type { Finding } from "../model/findings.ts";
import {
  type Candidate,
  type LayerOverlay,
  type ListingMap,
  isLayerId,
  isMap,
  styleOfMap,
  toggled,
} from "../model/maps.ts";
import { type HalfLook, type ViewState, bareOf, halfOf, layersOf } from "../model/state.ts";
import type { Vec3 } from "../model/space.ts";
import type { Block } from "../model/wire.ts";
import type { NamedValue } from "../base/readout.ts";
import type { Actions } from "./actions.ts";
import type { CaseLayers } from "./case-layers.ts";
import type { Comparison } from "./comparison.ts";
import { section } from "./fields.ts";
import { later } from "./later.ts";
import type { LayersSection } from "./layers-section.ts";
import type { MapsSection } from "./maps-section.ts";
import type { Nudge } from "./nudge.ts";
import type { OverlayControls } from "./overlay-controls.ts";

export interface AidsListener {
  readonly actions: Actions;
  /** What can be drawn has changed. */
  redraw(): void;
  announce(words: string): void;
  complain(problem: unknown): void;
  /** The voxels of a layer are others now. */
  forget(name: string): void;
  /** A place of the list becomes a finding, is dismissed, or neither. */
  judge(place: Candidate, judgement: "kept" | "dismissed" | null, map: ListingMap): void;
  /** The chart of the marked point stands here; null: where it usually does. */
  chart(place: HTMLElement | null): void;
}

interface Filled {
  readonly layers: CaseLayers;
  readonly maps: MapsSection;
  readonly added: LayersSection;
  readonly controls: OverlayControls;
  readonly comparison: Comparison;
  readonly nudge: Nudge;
}

export class Aids {
  readonly elements = [section(t("panel.maps"), true), section(t("panel.layers"), true)] as const;
  readonly #shown: ReadyCase;
  readonly #listener: AidsListener;
  #filling: Promise<Filled> | null = null;
  #filled: Filled | null = null;
  #list: LayerList | null = null;
  /** What a key wanted to see before the layers were listed. */
  #wanted: "grey" | "colours" | null = null;
  /** The layer that the map of the FLAIR belongs to. */
  #flairOf: string | undefined;
  #state: ViewState | null = null;
  /** The window that each texture was left with, by the id of its layer. */
  readonly #windows = new Map<string, Window>();
  #findings: readonly Finding[] = [];
  #isGone = false;

  constructor(shown: ReadyCase, listener: AidsListener) {
    this.#shown = shown;
    this.#listener = listener;
    for (const [at, element] of this.elements.entries()) {
      element.classList.add(at === 0 ? "maps" : "added");
      element.querySelector(".group-body")?.append(quiet(t("panel.loading")));
    }
  }

  /** Fills the sections, and lists the layers. */
  load(): Promise<Filled> {
    const filling = (this.#filling ??= this.#fill());
    // It is tried again when it is wanted again.
    filling.catch(() => (this.#filling = null));
    return filling;
  }

  show(state: ViewState): void {
    const before = this.#state;
    this.#state = state;
    this.#showFilled(state);
    // The layer of an address is an id alone, also if it is shown already.
    const isUnknown = [state.layer, state.beside?.layer].some((layer) => layer && !layer.intensity);
    const layers = layersOf(state);
    const isNew = isUnknown || layers.join() !== (before && layersOf(before).join());
    if (!isNew || layers.length === 0) return;
    if (this.#list) return this.#settle();
    const ask = async (): Promise<void> => (await this.load()).layers.ask();
    ask().catch((problem: unknown) => this.#listener.complain(problem));
  }

  /** A close-up with layers has the case itself beside them, each with its own window. */
  paired(state: ViewState): ViewState {
    if (state.layout !== "closer") return state;
    const hasLayers = state.layer !== null || state.overlay !== null;
    if (hasLayers === (state.beside !== null) && !state.swipe) return state;
    return { ...state, beside: hasLayers ? (state.beside ?? this.#own(state)) : null, swipe: null };
  }

  /** The state as it is drawn: as `#shownOf`, and with the outline of a place that the map leaves out. */
  drawable(state: ViewState): ViewState {
    const drawn = this.#shownOf(state);
    return this.#filled?.maps.outlined(drawn) ?? drawn;
  }

  /** Without what is hidden for now, and with the window of what has no layer. */
  #shownOf(state: ViewState): ViewState {
    const { beside } = state;
    const right = this.#known(state);
    const known = beside ? { ...right, beside: this.#known(beside), swipe: null } : right;
    const drawn = this.#filled?.nudge.placed(known) ?? known;
    if (!drawn.layer && !drawn.overlay)
      return drawn.swipe || drawn.has_edges ? { ...drawn, swipe: null, has_edges: false } : drawn;
    const isHidden = this.#filled?.comparison.isHidden;
    if (!isHidden && !drawn.swipe && !drawn.has_edges) return drawn;
    const both = { ...drawn, bare_window: this.#own(drawn).window };
    return isHidden ? bareOf(both) : both;
  }

  /** Without a layer that is not ready, and with what is known of the others. */
  #known<State extends HalfLook>(state: State): State {
    if (!state.overlay && !state.layer) return state;
    const overlay = state.overlay && this.#overlayOf(state.overlay);
    const found = state.layer && this.#filled?.layers.ready(state.layer.id);
    const grey = found && greyOf(found);
    if (!state.layer) return { ...state, overlay };
    if (found && grey) return { ...state, overlay, layer: { ...grey, ...aboutOf(found) } };
    return { ...state, overlay, layer: null, window: this.#shown.intensity.window };
  }

  async voxels(name: string): Promise<Block> {
    return (await this.load()).layers.voxels(name);
  }

  /** The values at a position of the layers that are shown, as far as their voxels are here. */
  valuesAt(position: Vec3): readonly NamedValue[] {
    const state = this.#state && this.drawable(this.#state);
    const { layer, overlay } = state ?? {};
    const shown = [
      layer && { id: layer.id, name: layer.about?.title ?? "", moved: layer.moved },
      overlay && { id: overlay.name, name: overlayName(overlay), moved: overlay.moved },
    ];
    return shown.flatMap((one) => {
      const value = one && !one.moved ? this.#filled?.layers.valueAt(one.id, position) : undefined;
      return one && value !== undefined ? [{ name: one.name, value }] : [];
    });
  }

  /** Goes to another place of the list. */
  async step(steps: number): Promise<void> {
    try {
      const words = await (await this.load()).maps.step(steps);
      if (words) this.#listener.announce(words);
    } catch (problem) {
      this.#listener.complain(problem);
    }
  }

  /** Shows which places are findings, or dismissed. */
  judged(findings: readonly Finding[]): void {
    this.#findings = findings;
    this.#filled?.maps.judged(findings);
  }

  /** Follows a command if it is one about layers. */
  take(command: Command): command is LayerCommand {
    switch (command.kind) {
      case "grey":
      case "colours":
        this.#next(command.kind);
        return true;
      case "hold":
      case "release":
      case "swipe":
      case "edges":
      case "nudge":
      case "beside":
      case "swap":
        this.#compare(command.kind);
        return true;
    }
    return false;
  }

  /** Shows the next of the added layers, or none after the last, once they are listed. */
  #next(how: "grey" | "colours"): void {
    if (!this.#list) {
      this.#wanted = how;
      this.load().catch((problem: unknown) => this.#listener.complain(problem));
      return;
    }
    const state = this.#state;
    const ready = this.#list.layers.filter((layer) => isAdded(layer) && isReady(layer));
    const usable = how === "grey" ? ready.filter((layer) => greyOf(layer)) : ready;
    if (!state || usable.length === 0) return this.#listener.announce(t("layers.none-ready"));
    const shown = how === "grey" ? state.layer?.id : state.overlay?.name;
    const ids = usable.map(({ id }) => id);
    const id = nextOf(ids, shown !== undefined && ids.includes(shown) ? shown : null);
    if (how === "grey") this.grey(id);
    else this.colours(id);
  }

  /** Hides the layers as long as a key is held, compares them in another way, or moves one. */
  #compare(how: Exclude<LayerCommand["kind"], "grey" | "colours">): void {
    const comparison = this.#filled?.comparison;
    if (how === "release") return comparison?.hide(false);
    if (!comparison || !(this.#state?.layer || this.#state?.overlay || this.#state?.beside))
      return this.#listener.announce(t("layers.none-shown"));
    if (how === "hold") comparison.hide(true);
    else if (how === "nudge") this.#filled?.nudge.begin();
    else comparison[how]();
  }

  /** Shows a layer that is ready as the texture; null: the case's own intensities. */
  grey(id: string | null): void {
    const state = this.#state;
    const found = id === null ? null : this.#filled?.layers.ready(id);
    const layer = (found && greyOf(found)) ?? null;
    if (!state || (id !== null && !layer)) return;
    this.#windows.set(state.layer?.id ?? "", state.window);
    const window = this.#windows.get(id ?? "") ?? (layer ?? this.#shown).intensity.window;
    this.#listener.actions.change({ layer, window }, true);
  }

  /** Shows a layer that is ready in colours, alone, or hides it again; null: none. */
  colours(id: string | null): void {
    const found = id === null ? null : this.#filled?.layers.ready(id);
    if (!this.#state || (id !== null && !found)) return;
    this.#listener.actions.change({ overlay: found ? toggled(this.#state.overlay, overlayOf(found)) : null }, true);
  }

  dispose(): void {
    this.#isGone = true;
    this.#filled?.layers.dispose();
    this.#filled?.comparison.stop();
  }

  #overlayOf(overlay: LayerOverlay): LayerOverlay | null {
    const found = this.#filled?.layers.ready(overlay.name);
    if (!found) return null;
    return isMap(overlay.name) ? overlay : { ...overlay, about: { ...styleOfLayer(found), ...aboutOf(found).about } };
  }

  #showFilled(state: ViewState): void {
    if (!this.#filled) return;
    const { maps, added, controls, comparison, nudge } = this.#filled;
    for (const part of [maps, added, comparison, nudge]) part.show(state);
    const slot = state.overlay && isLayerId(state.overlay.name) ? added.slot : maps.slot;
    if (controls.element.parentElement !== slot) slot.append(controls.element);
    // A map is compared where it is chosen, as long as no added layer is shown.
    const isAddedShown = layersOf(state).some(isLayerId);
    const place = isAddedShown ? added.slot : maps.slot;
    if (comparison.element.nextElementSibling !== place) place.before(comparison.element);
    // Before a layer is described, nobody knows its range.
    controls.show(state.overlay && isMap(state.overlay.name) ? state.overlay : this.drawable(state).overlay);
  }

  /** Takes over what the list says of the layers of the state; those that are gone are not shown. */
  #settle(): void {
    const state = this.#state;
    const list = this.#list;
    if (!state || !list) return;
    const right = this.#settled(state, list);
    const left = state.beside && this.#settled(state.beside, list);
    if (right || left) this.#listener.actions.change({ ...right, ...(left && { beside: left }) });
  }

  /** What a half shows by the list; null: it stays as it is. */
  #settled(half: HalfLook, { layers }: LayerList): HalfLook | null {
    const isGone = (id: string | undefined): boolean =>
      id !== undefined && (isLayerId(id) || id === "flair") && !layers.some((one) => one.id === id);
    const { window } = this.#shown.intensity;
    const [isBare, isPlain] = [isGone(half.layer?.id), isGone(half.overlay?.name)];
    if (isBare || isPlain) {
      this.#filled?.added.say(t("problem.no-such-layer"));
      return { ...halfOf(half), ...(isBare && { layer: null, window }), ...(isPlain && { overlay: null }) };
    }
    const found = half.layer && !half.layer.intensity && this.#filled?.layers.ready(half.layer.id);
    const layer = found && greyOf(found);
    if (!layer) return null;
    // An address that names a layer and no window means the layer's own.
    const isUnsaid = half.window.center === window.center && half.window.width === window.width;
    return { ...halfOf(half), layer, ...(isUnsaid && { window: layer.intensity.window }) };
  }

  /** What is seen of a state without its layers. */
  #own({ layer, window, colormap }: ViewState): HalfLook {
    const own = layer ? (this.#windows.get("") ?? this.#shown.intensity.window) : window;
    return { layer: null, overlay: null, window: own, colormap };
  }

  async #fill(): Promise<Filled> {
    const parts = await later();
    const { actions } = this.#listener;
    const layers = new parts.CaseLayers(this.#shown.id, (list) => this.#hear(list));
    const maps = new parts.MapsSection(this.#shown, layers, {
      ...actions,
      chart: (place) => this.#listener.chart(place),
      judge: (place, judgement, map) => this.#listener.judge(place, judgement, map),
    });
    maps.judged(this.#findings);
    const added = new parts.LayersSection(this.#shown, layers, {
      grey: (id) => this.grey(id),
      colours: (id) => this.colours(id),
      announce: (words) => this.#listener.announce(words),
    });
    const controls = new parts.OverlayControls(({ about: _, ...overlay }) => actions.change({ overlay }));
    const comparison = new parts.Comparison(
      actions,
      () => this.#listener.redraw(),
      (state) => this.#own(state),
    );
    const nudge = new parts.Nudge(this.#shown, layers, {
      moved: () => this.#listener.redraw(),
      take: (id) => (this.#state?.layer ? this.grey(id) : this.colours(id)),
    });
    added.slot.after(nudge.element);
    this.#filled = { layers, maps, added, controls, comparison, nudge };
    if (this.#isGone) layers.dispose();
    for (const [at, part] of [maps, added].entries())
      this.elements[at]?.querySelector(".group-body")?.replaceWith(part.element);
    if (this.#state) this.#showFilled(this.#state);
    void layers.ask().catch((problem: unknown) => this.#listener.complain(problem));
    return this.#filled;
  }

  #hear(list: LayerList): void {
    this.#list = list;
    const flair = list.layers.find(({ id }) => id === "flair");
    if (flair?.of_layer !== this.#flairOf) {
      this.#filled?.layers.forget("flair");
      this.#listener.forget("flair");
      this.#flairOf = flair?.of_layer;
    }
    const [map] = list.layers;
    if (map) this.#filled?.maps.tell(map);
    this.#filled?.maps.tellFlair(flair);
    this.#filled?.maps.plot(list);
    this.#filled?.added.tell(list);
    if (this.#state) this.#showFilled(this.#state);
    this.#settle();
    this.#listener.redraw();
    const wanted = this.#wanted;
    this.#wanted = null;
    if (wanted) this.#next(wanted);
  }
}

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
