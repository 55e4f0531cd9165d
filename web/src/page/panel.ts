// The visible controls: everything that hands and keys do can be done here as well.

import { VIEW_NAMES, viewName } from "../model/camera.ts";
import type { ReadyCase, Window } from "../model/case.ts";
import type { StateHistory } from "../model/history.ts";
import { ARROW_PIXELS, type Change, boundWindow } from "../model/controls.ts";
import { h, iconButton, setText, setValue } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import {
  COLORMAPS,
  CONVENTIONS,
  SLAB_LIMIT_MM,
  type ViewState,
  WAYS,
  WINDOW_PRESETS,
  ZOOM_RANGE,
  boundOutlines,
  clampDepth,
  presetWindow,
} from "../model/state.ts";
import { readDepths } from "../model/query.ts";
import type { Actions } from "./actions.ts";
import { button, line, press, row, section, tall } from "./fields.ts";
import { PointSection } from "./point-section.ts";

/** How many times the screen's pixels a saved picture can have. */
const TIMES = [1, 2, 4] as const;

/** Sections that others fill. */
export interface PanelSections {
  readonly maps: HTMLElement;
  readonly sweep: HTMLElement;
  readonly case: HTMLElement;
}

/** The panel beside the picture. */
export class Panel {
  readonly element: HTMLElement;
  readonly #shown: ReadyCase;
  readonly #actions: Actions;
  readonly #views: HTMLElement;
  readonly #presets: HTMLElement;
  readonly #zoom: HTMLInputElement;
  readonly #window: Readonly<Record<keyof Window, { range: HTMLInputElement; number: HTMLInputElement }>>;
  #windowShown: Window;
  readonly #colormap: HTMLSelectElement;
  readonly #way: HTMLSelectElement;
  readonly #slab: HTMLInputElement;
  readonly #light: HTMLInputElement;
  readonly #convention: HTMLSelectElement;
  readonly #averages: HTMLInputElement;
  readonly #outlines: HTMLInputElement;
  readonly #times: HTMLSelectElement;
  /** What is known of the marked point. */
  readonly point: PointSection;
  readonly #undo: HTMLButtonElement;
  readonly #redo: HTMLButtonElement;
  readonly #zoomText = h("span", { class: "value quiet", "aria-hidden": "true" });
  readonly #slabText = h("span", { class: "value quiet", "aria-hidden": "true" });
  readonly #note = h("p", { class: "quiet", role: "status" });

  constructor(shown: ReadyCase, actions: Actions, sections: PanelSections) {
    this.#shown = shown;
    this.#windowShown = shown.intensity.window;
    this.#actions = actions;
    this.#views = h(
      "div",
      { class: "buttons" },
      ...VIEW_NAMES.map((name) =>
        button(t(`view.${name}`), () => actions.command({ kind: "view", name }), {
          value: name,
          "aria-pressed": "false",
        }),
      ),
    );
    this.#zoom = this.#slider(
      "zoom",
      t("zoom.label"),
      [Math.log2(ZOOM_RANGE[0]), Math.log2(ZOOM_RANGE[1]), 0.05],
      (value) => ({ zoom: 2 ** value }),
    );
    this.#presets = h(
      "div",
      { class: "buttons" },
      ...WINDOW_PRESETS.map((preset) =>
        button(t(`window.${preset}`), () => actions.command({ kind: "window", preset }), {
          value: preset,
          "aria-pressed": "false",
        }),
      ),
    );
    const { min, max } = shown.intensity;
    const range = max - min || 1;
    this.#window = {
      center: this.#windowPart("center", [min + 0.5, max + 0.5]),
      width: this.#windowPart("width", [1 + range / 500, 1 + range]),
    };
    this.#colormap = this.#choice(
      "colormap",
      t("colormap.label"),
      COLORMAPS.map((name) => [name, t(`colormap.${name}`)]),
      (colormap) => ({ colormap }),
    );
    this.#way = this.#choice(
      "way",
      t("way.label"),
      WAYS.map((name) => [name, t(`way.${name}`)]),
      (way) => ({ way }),
    );
    this.#slab = this.#slider("slab", t("slab.label"), [0, Math.min(SLAB_LIMIT_MM, 5), 0.5], (slab_mm) => ({
      slab_mm,
    }));
    this.#light = this.#slider("light", t("light.label"), [0, 1, 0.05], (share) => ({
      ambient: Number((1 - share).toFixed(2)),
    }));
    this.#convention = this.#choice(
      "convention",
      t("convention.label"),
      CONVENTIONS.map((name) => [name, t(`convention.${name}`)]),
      (convention) => ({ convention }),
    );
    this.#averages = h("input", {
      type: "checkbox",
      id: "averages",
      change: () => actions.change({ averages_shallow: this.#averages.checked }, true),
    });
    this.#outlines = h("input", {
      type: "text",
      id: "outlines",
      inputmode: "decimal",
      placeholder: "0, 20",
      "aria-label": t("outlines.label"),
      change: () => {
        const depths = readDepths(this.#outlines.value, clampDepth(Infinity, shown)) ?? [];
        actions.change({ outlines_mm: boundOutlines(depths, shown) }, true);
      },
    });
    this.#times = h(
      "select",
      { id: "times", "aria-label": t("export.times") },
      ...TIMES.map((times) => h("option", { value: times }, `${times}×`)),
    );
    const times = (): number => Number(this.#times.value);
    this.#undo = iconButton("undo", t("undo"), () => actions.command({ kind: "undo" }));
    this.#redo = iconButton("redo", t("redo"), () => actions.command({ kind: "redo" }));
    this.point = new PointSection(actions);
    this.element = h(
      "aside",
      { class: "panel", "aria-label": t("panel.label") },
      section(
        t("panel.view"),
        true,
        this.#views,
        line(t("zoom.label"), this.#zoom, this.#zoomText),
        this.#pads(),
        row(
          button(t("reset"), () => actions.command({ kind: "reset" })),
          this.#undo,
          this.#redo,
        ),
      ),
      section(
        t("panel.window"),
        true,
        this.#presets,
        line(t("window.center"), this.#window.center.range, this.#window.center.number),
        line(t("window.width"), this.#window.width.range, this.#window.width.number),
        line(
          t("colormap.label"),
          this.#colormap,
          button(t("invert"), () => actions.command({ kind: "invert" })),
        ),
      ),
      sections.maps,
      section(t("panel.point"), true, ...this.point.parts),
      section(
        t("panel.drawing"),
        false,
        line(t("way.label"), this.#way),
        line(t("light.label"), this.#light),
        line(t("slab.label"), this.#slab, this.#slabText),
        h("label", { class: "inline" }, this.#averages, t("averages.label")),
        tall(t("convention.label"), this.#convention),
        line(t("outlines.label"), this.#outlines, h("span", { class: "quiet" }, "mm")),
      ),
      sections.sweep,
      sections.case,
      section(
        t("panel.export"),
        false,
        row(
          this.#times,
          button(t("export.screenshot"), () => actions.screenshot(times())),
          button(t("export.copy-picture"), () => actions.copyPicture(times())),
          button(t("export.server"), () => actions.serverPicture()),
          button(t("export.series"), () => actions.series()),
          button(t("export.copy"), () => actions.copyAddress()),
        ),
        this.#note,
      ),
    );
  }

  show(state: ViewState): void {
    this.#windowShown = state.window;
    press(this.#views, viewName(state.orientation));
    const same = (window: Window): boolean =>
      Math.abs(window.center - state.window.center) + Math.abs(window.width - state.window.width) <
      1e-3 * state.window.width;
    press(
      this.#presets,
      WINDOW_PRESETS.find((preset) => same(boundWindow(presetWindow(preset, this.#shown), this.#shown))) ?? null,
    );
    setValue(this.#zoom, Math.log2(state.zoom).toFixed(2));
    const zoom = `${number(state.zoom * 100)} %`;
    this.#zoom.setAttribute("aria-valuetext", zoom);
    setText(this.#zoomText, zoom);
    for (const part of ["center", "width"] as const) {
      setValue(this.#window[part].range, state.window[part]);
      setValue(this.#window[part].number, windowNumber(state.window[part]));
    }
    setValue(this.#colormap, state.colormap);
    setValue(this.#way, state.way);
    setValue(this.#slab, state.slab_mm);
    const slab = `±${number(state.slab_mm, 1)} mm`;
    this.#slab.setAttribute("aria-valuetext", slab);
    setText(this.#slabText, slab);
    this.#averages.checked = state.averages_shallow;
    if (document.activeElement !== this.#outlines) this.#outlines.value = state.outlines_mm.join(", ");
    setValue(this.#light, (1 - state.ambient).toFixed(2));
    setValue(this.#convention, state.convention);
  }

  /** Whether there is anything to undo, or to redo. */
  showHistory({ canUndo, canRedo }: Pick<StateHistory, "canUndo" | "canRedo">): void {
    this.#undo.disabled = !canUndo;
    this.#redo.disabled = !canRedo;
  }

  note(words: string): void {
    setText(this.#note, words);
  }

  #slider(
    id: string,
    label: string,
    [min, max, step]: readonly [number, number, number],
    change: (value: number) => Change,
  ): HTMLInputElement {
    const input = h("input", {
      type: "range",
      id,
      min,
      max,
      step,
      "aria-label": label,
      input: () => this.#actions.change(change(input.valueAsNumber)),
    });
    return input;
  }

  #choice<Value extends string>(
    id: string,
    label: string,
    options: readonly (readonly [Value, string])[],
    change: (value: Value) => Change,
  ): HTMLSelectElement {
    const select = h(
      "select",
      { id, "aria-label": label, change: () => this.#actions.change(change(select.value as Value), true) },
      ...options.map(([value, words]) => h("option", { value }, words)),
    );
    return select;
  }

  #windowPart(
    part: keyof Window,
    [min, max]: readonly [number, number],
  ): { range: HTMLInputElement; number: HTMLInputElement } {
    const label = t(`window.${part}`);
    let state: Window = this.#shown.intensity.window;
    const take = (input: HTMLInputElement): void => {
      const value = input.valueAsNumber;
      const other = part === "center" ? "width" : "center";
      state = { ...state, [other]: this.#window[other].range.valueAsNumber };
      if (Number.isFinite(value) && (part === "center" || value >= 1)) {
        this.#actions.change({ window: boundWindow({ ...state, [part]: value }, this.#shown) });
      }
    };
    const step = (max - min) / 500;
    const range = h("input", {
      type: "range",
      id: `window-${part}`,
      min,
      max,
      step,
      "aria-label": label,
      input: () => take(range),
    });
    const field = h("input", {
      type: "number",
      id: `window-${part}-number`,
      step: "any",
      "aria-label": label,
      change: () => {
        take(field);
        field.value = windowNumber(this.#windowShown[part]);
      },
    });
    return { range, number: field };
  }

  /** Arrows that turn and move, for those who cannot drag. */
  #pads(): HTMLElement {
    const arrows = [
      ["left", -1, 0],
      ["up", 0, -1],
      ["down", 0, 1],
      ["right", 1, 0],
    ] as const;
    const pad = (kind: "turn" | "pan"): HTMLElement =>
      h(
        "div",
        { class: "line", role: "group", "aria-label": t(`${kind}.label`) },
        h("span", { class: "line-label", "aria-hidden": "true" }, t(`${kind}.label`)),
        ...arrows.map(([name, x, y]) =>
          iconButton(name, t(`${kind}.${name}`), () =>
            this.#actions.command({ kind, move: [x * ARROW_PIXELS, y * ARROW_PIXELS] }),
          ),
        ),
      );
    return h("div", { class: "pads" }, pad("turn"), pad("pan"));
  }
}

/** A window's level or width in five figures. */
const windowNumber = (value: number): string => String(Number(value.toPrecision(5)));
