// The visible controls: everything that hands and keys do can be done here as well.

import { type ViewName, viewName } from "../model/camera.ts";
import type { Intensity, ReadyCase, Window } from "../model/case.ts";
import type { StateHistory } from "../model/history.ts";
import { ARROW_PIXELS, boundWindow } from "../model/controls.ts";
import { h, iconButton, setValue } from "../base/dom.ts";
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
  textureOf,
} from "../model/state.ts";
import { readDepths } from "../model/query.ts";
import { SURFACES } from "../model/surfaces.ts";
import type { Actions } from "./actions.ts";
import {
  Slider,
  button,
  choice,
  choiceOfButtons,
  line,
  press,
  range as slider,
  row,
  section,
  tall,
  ticked,
} from "./fields.ts";
import { PointSection } from "./point-section.ts";

/** As the letters stand in the row. */
const VIEW_ORDER: readonly ViewName[] = ["left", "right", "anterior", "posterior", "superior", "inferior"];

/** What the panel has sections for; `all` shows those of every task. */
export const TASKS = ["read", "layers", "case", "all"] as const;
export type Task = (typeof TASKS)[number];

/** Sections that others fill. */
interface PanelSections {
  readonly maps: HTMLElement;
  readonly layers: HTMLElement;
  /** More about drawing. */
  readonly drawing: readonly HTMLElement[];
  /** What a reader writes down. */
  readonly reading: readonly HTMLElement[];
  /** About the case itself, and what leaves it. */
  readonly last: readonly HTMLElement[];
}

/** Says of which tasks a section is. */
function of(tasks: string, element: HTMLElement): HTMLElement {
  element.dataset.task = tasks;
  return element;
}

/** The panel beside the picture. */
export class Panel {
  readonly element: HTMLElement;
  readonly #shown: ReadyCase;
  readonly #actions: Actions;
  readonly #views: HTMLElement;
  readonly #surfaces: HTMLElement;
  readonly #presets: HTMLElement;
  readonly #zoom: Slider;
  readonly #window: Readonly<Record<keyof Window, { range: HTMLInputElement; number: HTMLInputElement }>>;
  #windowShown: Window;
  #texture: { readonly intensity: Intensity };
  readonly #colormap: HTMLSelectElement;
  readonly #way: HTMLSelectElement;
  readonly #slab: Slider;
  readonly #light: Slider;
  readonly #convention: HTMLSelectElement;
  readonly #averages: HTMLInputElement;
  readonly #outlines: HTMLInputElement;
  /** What is known of the marked point. */
  readonly point: PointSection;
  readonly #undo: HTMLButtonElement;
  readonly #redo: HTMLButtonElement;

  readonly #tasks: HTMLElement;

  /** `chosen` hears which task is chosen. */
  constructor(shown: ReadyCase, actions: Actions, sections: PanelSections, chosen: (task: Task) => void) {
    this.#shown = shown;
    this.#windowShown = shown.intensity.window;
    this.#texture = shown;
    this.#actions = actions;
    this.#views = choiceOfButtons(
      t("panel.view"),
      VIEW_ORDER,
      (name) => t(`letter.${name}`),
      (name) => actions.command({ kind: "view", name }),
    );
    this.#views.classList.add("letters");
    for (const [at, one] of [...this.#views.children].entries()) {
      const name = t(`view.${VIEW_ORDER[at] ?? "left"}`);
      one.setAttribute("aria-label", name);
      one.setAttribute("title", name);
    }
    this.#surfaces = choiceOfButtons(
      t("panel.surface"),
      SURFACES,
      (name) => t(`surface.${name}`),
      (name) => actions.command({ kind: "surface", name }),
    );
    this.#surfaces.classList.add("surfaces");
    // Left and right are the names of views, too.
    for (const [at, one] of [...this.#surfaces.children].entries())
      one.setAttribute("aria-label", t(`surface.${SURFACES[at] ?? "whole"}-said`));
    this.#zoom = new Slider("zoom", t("zoom.label"), [...ZOOM_RANGE.map(Math.log2), 0.05], (value) =>
      actions.change({ zoom: 2 ** value }),
    );
    this.#presets = choiceOfButtons(
      t("panel.window"),
      WINDOW_PRESETS,
      (preset) => t(`window.${preset}`),
      (preset) => actions.command({ kind: "window", preset }),
    );
    this.#window = { center: this.#windowPart("center"), width: this.#windowPart("width") };
    this.#rangeWindow();
    this.#colormap = choice(
      "colormap",
      t("colormap.label"),
      COLORMAPS,
      (name) => t(`colormap.${name}`),
      (colormap) => actions.change({ colormap }, true),
    );
    this.#way = choice(
      "way",
      t("way.label"),
      WAYS,
      (name) => t(`way.${name}`),
      (way) => actions.change({ way }, true),
    );
    this.#slab = new Slider("slab", t("slab.label"), [0, Math.min(SLAB_LIMIT_MM, 5), 0.5], (slab_mm) =>
      actions.change({ slab_mm }),
    );
    this.#light = new Slider("light", t("light.label"), [0, 1, 0.05], (share) =>
      actions.change({ ambient: Number((1 - share).toFixed(2)) }),
    );
    this.#convention = choice(
      "convention",
      t("convention.label"),
      CONVENTIONS,
      (name) => t(`convention.${name}`),
      (convention) => actions.change({ convention }, true),
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
        const text = this.#outlines.value;
        const depths = text.trim() ? readDepths(text, clampDepth(Infinity, shown)) : [];
        // What cannot be read stays to be corrected, and changes nothing.
        this.#outlines.setAttribute("aria-invalid", String(!depths));
        if (depths) actions.change({ outlines_mm: boundOutlines(depths, shown) }, true);
      },
    });
    this.#undo = iconButton("undo", t("undo"), () => actions.command({ kind: "undo" }));
    this.#redo = iconButton("redo", t("redo"), () => actions.command({ kind: "redo" }));
    this.point = new PointSection(actions);
    this.#tasks = choiceOfButtons(
      t("task.label"),
      TASKS,
      (task) => t(`task.${task}`),
      (task) => {
        this.choose(task);
        chosen(task);
      },
    );
    this.#tasks.classList.add("tasks");
    this.element = h(
      "aside",
      { class: "panel", "aria-label": t("panel.label") },
      this.#tasks,
      // In the order of a reading: where to look, what is there, what is written down, how it is shown.
      of("read", sections.maps),
      of("read", section(t("panel.point"), true, ...this.point.parts)),
      ...sections.reading.map((one) => of("read", one)),
      of(
        "read layers",
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
      ),
      of("layers", sections.layers),
      of(
        "read",
        section(
          t("panel.view"),
          true,
          this.#views,
          this.#surfaces,
          this.#zoom.element,
          this.#pads(),
          row(
            button(t("reset"), () => actions.command({ kind: "reset" })),
            this.#undo,
            this.#redo,
          ),
        ),
      ),
      of(
        "layers",
        section(
          t("panel.drawing"),
          false,
          line(t("way.label"), this.#way),
          this.#light.element,
          this.#slab.element,
          ticked(this.#averages, t("averages.label")),
          tall(t("convention.label"), this.#convention),
          ...sections.drawing,
          line(t("outlines.label"), this.#outlines, h("span", { class: "quiet" }, "mm")),
        ),
      ),
      ...sections.last.map((one) => of("case", one)),
    );
  }

  /** Shows the sections of a task. */
  choose(task: Task): void {
    this.element.dataset.task = task;
    press(this.#tasks, task);
    // A task that is all folded would show nothing.
    const own = [...this.element.querySelectorAll<HTMLDetailsElement>(`:scope > details[data-task~=${task}]`)];
    if (own[0] && own.every(({ open }) => !open)) own[0].open = true;
  }

  /** Brings a section of a task to where it can be seen. */
  reach(task: Task): void {
    if (this.element.dataset.task !== "all") this.choose(task);
  }

  show(state: ViewState): void {
    this.#windowShown = state.window;
    const texture = textureOf(state, this.#shown);
    if (texture.intensity !== this.#texture.intensity) {
      this.#texture = texture;
      this.#rangeWindow();
    }
    press(this.#views, viewName(state.orientation));
    press(this.#surfaces, state.surface);
    const same = (window: Window): boolean =>
      Math.abs(window.center - state.window.center) + Math.abs(window.width - state.window.width) <
      1e-3 * state.window.width;
    press(
      this.#presets,
      WINDOW_PRESETS.find((preset) => same(boundWindow(presetWindow(preset, texture), texture))) ?? null,
    );
    this.#zoom.show(Math.log2(state.zoom).toFixed(2), `${number(state.zoom * 100)} %`);
    for (const part of ["center", "width"] as const) {
      setValue(this.#window[part].range, state.window[part]);
      setValue(this.#window[part].number, windowNumber(state.window[part]));
    }
    setValue(this.#colormap, state.colormap);
    setValue(this.#way, state.way);
    this.#slab.show(state.slab_mm, `±${number(state.slab_mm, 1)} mm`);
    this.#averages.checked = state.averages_shallow;
    if (document.activeElement !== this.#outlines) this.#outlines.value = state.outlines_mm.join(", ");
    this.#light.show((1 - state.ambient).toFixed(2), `${number(100 * (1 - state.ambient))} %`);
    setValue(this.#convention, state.convention);
  }

  /** Only the whole brain has a surface, for this reason. */
  refuseParts(reason: string): void {
    for (const one of this.#surfaces.querySelectorAll<HTMLButtonElement>("button:not([value=whole])")) {
      one.disabled = true;
      one.title = reason;
    }
  }

  /** Whether there is anything to undo, or to redo. */
  showHistory({ canUndo, canRedo }: Pick<StateHistory, "canUndo" | "canRedo">): void {
    this.#undo.disabled = !canUndo;
    this.#redo.disabled = !canRedo;
  }

  /** The sliders of the window reach as far as the values of the texture. */
  #rangeWindow(): void {
    const { min, max } = this.#texture.intensity;
    const range = max - min || 1;
    const reach = { center: [min + 0.5, max + 0.5], width: [1 + range / 500, 1 + range] } as const;
    for (const part of ["center", "width"] as const) {
      const [low, high] = reach[part];
      Object.assign(this.#window[part].range, { min: low, max: high, step: (high - low) / 500 });
    }
  }

  #windowPart(part: keyof Window): { range: HTMLInputElement; number: HTMLInputElement } {
    const label = t(`window.${part}`);
    const take = (input: HTMLInputElement): void => {
      const value = input.valueAsNumber;
      if (Number.isFinite(value) && (part === "center" || value >= 1)) {
        this.#actions.change({ window: boundWindow({ ...this.#windowShown, [part]: value }, this.#texture) });
      }
    };
    const range = slider(`window-${part}`, label, () => take(range));
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

/** Whether the slices have one zoom. */
export function linkedZoom(isLinked: boolean, link: (isLinked: boolean) => void): HTMLElement {
  const box = h("input", { type: "checkbox", id: "linked-zoom", checked: isLinked, change: () => link(box.checked) });
  return ticked(box, t("zoom.linked"));
}

/** A window's level or width in five figures. */
const windowNumber = (value: number): string => String(Number(value.toPrecision(5)));
