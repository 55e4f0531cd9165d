// The widget of notebooks: the surface of a case with its depth, whose traits Python sets and watches (`_view.py`).

import { signal } from "@preact/signals";

import { getCase } from "../base/api.ts";
import { caseIdentity } from "../base/case-words.ts";
import { h, setText, setValue, tell } from "../base/dom.ts";
import { languageFor, learn, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { depthWords } from "../base/readout.ts";
import { NAMED_VIEWS, type ViewName, edgesOf, project, viewName } from "../model/camera.ts";
import type { ReadyCase } from "../model/case.ts";
import { type Change, dragWindow, pan, pinch, turn, zoomAt } from "../model/controls.ts";
import { overlayOf, styleOfLayer } from "../model/layers.ts";
import { type LayerOverlay, firstOverlay, isMap } from "../model/maps.ts";
import { doubtsOf } from "../model/quality.ts";
import type { Vec2 } from "../model/space.ts";
import { DEPTH_STEP_MM, type ViewState, clampDepth, firstState } from "../model/state.ts";
import type { SurfaceName } from "../model/surfaces.ts";
import { Cortex } from "../panes/cortex.ts";
import { listen } from "../panes/gestures.ts";
import { MapBar } from "../panes/map-bar.ts";
import { Overlay } from "../panes/overlay.ts";
import { CaseLayers } from "../store/case-layers.ts";
import style from "../style.css";
import { Kernel, type Model } from "./kernel.ts";

const ZOOM_PER_PIXEL = 0.002;

/** What a notebook needs besides the style of the page: no style of one reaches the other. */
const OWN_STYLE = `
:host { display: block; }
.view { display: grid; gap: 4px; padding: 4px; font-size: var(--text); color: var(--ink); background: var(--ground); }
.view > label { display: flex; gap: 0.5rem; align-items: center; }
.view input { flex: 1 1 auto; accent-color: var(--accent); }
`;

/** The surface in a pane, as the traits of a model say. */
class View {
  readonly element: HTMLElement;
  readonly #model: Model;
  readonly #case: ReadyCase;
  readonly #layers: CaseLayers;
  readonly #cortex: Cortex;
  readonly #overlay: Overlay;
  readonly #bar = new MapBar();
  readonly #slider: HTMLInputElement;
  readonly #trouble = h("p", { class: "bad", role: "alert", hidden: true });
  readonly #pane: HTMLElement;
  readonly #gone = new AbortController();
  #state: ViewState;
  #isMoving = false;
  /** The overlay that was asked for last. */
  #asked: string | null = null;
  /** What is wrong with the picture, and with what lies over it. */
  #told = { picture: "", overlay: "" };
  /** Whether Python is just being told what a hand has changed. */
  #isSaying = false;

  constructor(model: Model, shown: ReadyCase) {
    this.#model = model;
    this.#case = shown;
    this.#layers = new CaseLayers(shown.id);
    this.#state = firstState(shown);
    const host = h("div", { class: "surface-host" });
    this.#pane = h(
      "section",
      {
        class: "pane surface",
        tabindex: 0,
        "aria-label": t("surface.label"),
        // No half is beside it.
        "data-beside": "",
        style: `height: ${String(model.get("height"))}px`,
      },
      host,
    );
    this.#overlay = new Overlay(this.#pane);
    this.#overlay.identity(caseIdentity(shown));
    this.#pane.append(this.#bar.element);
    this.#slider = h("input", {
      type: "range",
      min: 0,
      max: Math.floor(shown.max_depth_mm),
      step: DEPTH_STEP_MM,
      input: () => this.#change({ depth_mm: clampDepth(Number(this.#slider.value), shown) }),
    });
    const doubts = doubtsOf(shown.quality).map((doubt) => t(`quality.${doubt}.text`));
    this.element = h(
      "div",
      { class: "view" },
      h("p", { class: "bad", hidden: doubts.length === 0 }, doubts.join(" ")),
      this.#trouble,
      this.#pane,
      h("label", {}, t("depth.label"), this.#slider),
    );
    this.#cortex = new Cortex(host, shown, {
      onDrawn: (state) => this.#write(state),
      onStatus: ({ trouble }) => this.#tell({ ...this.#told, picture: trouble }),
      layer: (name) => this.#layers.voxels(name),
      noPart: (problem) => this.#complain(problem),
      serverOnly: false,
      shared: null,
    });
    listen(
      this.#pane,
      {
        drag: (kind, move) => {
          if (kind === "turn") this.#change(turn(this.#state, move, this.#size));
          else if (kind === "pan") this.#change(pan(this.#state, shown, move, this.#size));
          else this.#change(dragWindow(this.#state, shown, move, "up-brighter"));
        },
        pinch: (fingers) => this.#change(pinch(this.#state, shown, fingers, this.#size)),
        wheel: (pixels, _, place) =>
          this.#change(zoomAt(this.#state, shown, Math.exp(-ZOOM_PER_PIXEL * pixels), place, this.#size)),
        pick: () => {},
        busy: (isBusy) => {
          this.#isMoving = isBusy;
          this.#draw();
        },
      },
      signal(false),
    );
    for (const name of ["depth_mm", "view", "surface", "overlay"]) model.on(`change:${name}`, this.#follow);
    this.#follow();
  }

  /** Fetches what it draws with; the element is in the notebook by now. */
  async load(): Promise<void> {
    try {
      await this.#cortex.load(this.#gone.signal, () => {});
    } catch (problem) {
      if (!this.#gone.signal.aborted) this.#complain(problem);
    }
  }

  dispose(): void {
    for (const name of ["depth_mm", "view", "surface", "overlay"]) this.#model.off(`change:${name}`, this.#follow);
    this.#gone.abort();
    this.#layers.dispose();
    this.#cortex.dispose();
  }

  get #size(): Vec2 {
    return [this.#pane.clientWidth, this.#pane.clientHeight];
  }

  #complain(problem: unknown): void {
    this.#tell({ ...this.#told, overlay: problemWords(problem) });
  }

  /** Says what is wrong with the picture, and what with what lies over it. */
  #tell(told: { readonly picture: string; readonly overlay: string }): void {
    this.#told = told;
    tell(this.#trouble, [told.picture, told.overlay].filter(Boolean).join(" "));
  }

  #draw(): void {
    setValue(this.#slider, this.#state.depth_mm);
    this.#cortex.draw(this.#state, this.#isMoving);
  }

  /** A hand has changed the state: Python hears of it. */
  #change(change: Change): void {
    this.#state = { ...this.#state, ...change };
    this.#draw();
    const said = { depth_mm: this.#state.depth_mm, view: viewName(this.#state.orientation) };
    const changed = Object.entries(said).filter(([name, value]) => this.#model.get(name) !== value);
    this.#isSaying = true;
    for (const [name, value] of changed) this.#model.set(name, value);
    this.#isSaying = false;
    if (changed.length > 0) this.#model.save_changes();
  }

  /** Python has changed a trait, or this view's own hand, which changes nothing. */
  readonly #follow = (): void => {
    if (this.#isSaying) return;
    const view = this.#model.get("view") as ViewName | null;
    const overlay = this.#model.get("overlay") as string | null;
    this.#state = {
      ...this.#state,
      depth_mm: clampDepth(Number(this.#model.get("depth_mm")), this.#case),
      surface: this.#model.get("surface") as SurfaceName,
      // A head that was turned by hand has none of the names.
      ...(view && { orientation: NAMED_VIEWS[view] }),
      ...(overlay === null && { overlay: null }),
    };
    this.#draw();
    if (overlay === null && this.#asked !== null) this.#tell({ ...this.#told, overlay: "" });
    if (overlay !== null && overlay !== this.#asked) void this.#lay(overlay);
    this.#asked = overlay;
  };

  /** Shows a map or a layer over the surface, once the server has it. */
  async #lay(name: string): Promise<void> {
    try {
      await this.#layers.again();
      if (this.#asked !== name || this.#gone.signal.aborted) return;
      this.#state = { ...this.#state, overlay: this.#overlayOf(name) };
      this.#draw();
    } catch (problem) {
      if (!this.#gone.signal.aborted) this.#complain(problem);
    }
  }

  #overlayOf(name: string): LayerOverlay | null {
    const found = this.#layers.list.peek()?.layers.find((layer) => layer.name === name || layer.id === name);
    const ready = found && this.#layers.ready(found.id);
    this.#tell({ ...this.#told, overlay: ready ? "" : (found?.reason ?? t("problem.no-such-layer")) });
    if (!ready) return null;
    if (isMap(ready.id)) return firstOverlay(ready.id);
    return { ...overlayOf(ready), about: { ...styleOfLayer(ready), title: ready.name, origin: "" } };
  }

  /** Writes what stands on the picture of a state. */
  #write(state: ViewState | null): void {
    this.#pane.classList.toggle("blank", state === null);
    if (!state) return;
    const [width] = this.#size;
    const name = viewName(state.orientation);
    const surface = state.surface === "whole" ? "" : `  ${t(`surface.${state.surface}-said`)}`;
    this.#overlay.letter(edgesOf(state.orientation));
    this.#overlay.title(`${depthWords(state)}${name ? `  ${t(`view.${name}`)}` : ""}${surface}`);
    this.#overlay.scale(project(state, this.#case.envelope_sphere, this.#size).mm_per_pixel, width);
    this.#bar.show(state.overlay);
  }
}

/** Shows the case of a model in a cell of a notebook; what is returned ends that. */
async function render({ model, el }: { readonly model: Model; readonly el: HTMLElement }): Promise<() => void> {
  const kernel = new Kernel(model);
  await learn(languageFor(navigator.languages));
  const root = el.attachShadow({ mode: "open" });
  const sheet = h("style");
  // Nothing in a shadow is the root of the page.
  setText(sheet, style.replaceAll(":root", ":host") + OWN_STYLE);
  root.append(sheet);
  let view: View | null = null;
  try {
    const shown = { ...(await getCase(kernel.own)), id: kernel.own };
    if (shown.state !== "ready") throw new Error(shown.state);
    view = new View(model, shown);
    root.append(view.element);
    void view.load();
  } catch (problem) {
    root.append(h("p", { class: "bad", role: "alert" }, problemWords(problem)));
  }
  return () => {
    view?.dispose();
    kernel.dispose();
  };
}

export default { render };
