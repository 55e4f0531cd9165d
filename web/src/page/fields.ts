// The parts that panels are made of.

import { type Attributes, type Child, h, setText, setValue } from "../base/dom.ts";

export const button = (words: Child, onClick: () => void, attributes: Record<string, string> = {}): HTMLButtonElement =>
  h("button", { click: onClick, ...attributes }, words);

/** A choice among values in words; `take` hears which. */
export function choice<Value extends string | number>(
  id: string,
  label: string,
  values: readonly Value[],
  words: (value: Value) => string,
  take: (value: Value) => void = () => {},
): HTMLSelectElement {
  const select = h(
    "select",
    { id, "aria-label": label, change: () => take(values[select.selectedIndex] as Value) },
    ...values.map((value) => h("option", { value }, words(value))),
  );
  return select;
}

/** A choice with a button for each value. */
export const choiceOfButtons = <Value extends string>(
  label: string,
  values: readonly Value[],
  words: (value: Value) => string,
  take: (value: Value) => void,
): HTMLElement =>
  h(
    "div",
    { class: "buttons", role: "group", "aria-label": label },
    ...values.map((value) => button(words(value), () => take(value), { value, "aria-pressed": "false" })),
  );

/** A slider with its label and, beside it, what its place means. */
export class Slider {
  readonly input: HTMLInputElement;
  readonly element: HTMLElement;
  readonly #text = h("span", { class: "value quiet", "aria-hidden": "true" });

  constructor(id: string, label: string, [min, max, step]: readonly number[], take: (value: number) => void) {
    const input = range(id, label, take);
    Object.assign(input, { min, max, step });
    this.input = input;
    this.element = line(label, input, this.#text);
  }

  show(value: string | number, words: string): void {
    setValue(this.input, value);
    this.input.setAttribute("aria-valuetext", words);
    setText(this.#text, words);
  }
}

export function range(id: string, label: string, take: (value: number) => void): HTMLInputElement {
  const input = h("input", { type: "range", id, "aria-label": label, input: () => take(input.valueAsNumber) });
  return input;
}

/** A box to tick, with words behind it. */
export const ticked = (box: HTMLInputElement, words: string): HTMLElement =>
  h("label", { class: "inline" }, box, words);

/** What is clicked in the place of a file input. */
export const fileButton = (words: string): HTMLElement =>
  h("span", { class: "file-button", "aria-hidden": "true" }, words);

/** An input for files; `take` gets those that are chosen. */
export function fileInput(id: string, take: (files: readonly File[]) => void, attributes: Attributes = {}) {
  const input = h("input", { type: "file", id, change: () => take([...(input.files ?? [])]), ...attributes });
  return input;
}

export const section = (title: string, open: boolean, ...children: Child[]): HTMLElement =>
  h("details", { class: "group", open }, h("summary", {}, title), h("div", { class: "group-body" }, ...children));

/** A labelled line: the label, then its controls. */
export const line = (label: string, ...controls: HTMLElement[]): HTMLElement =>
  h("div", { class: "line" }, h("span", { class: "line-label", "aria-hidden": "true" }, label), ...controls);

/** The same with what is too long for a line below its label. */
export const tall = (label: string, control: HTMLElement): HTMLElement => {
  const element = line(label, control);
  element.classList.add("tall");
  return element;
};

/** Buttons side by side. */
export const row = (...children: Child[]): HTMLElement => h("div", { class: "row" }, ...children);

/** Marks the chosen one of a group of buttons. */
export function press(group: HTMLElement, value: string | null): void {
  for (const one of group.querySelectorAll("button")) one.setAttribute("aria-pressed", String(one.value === value));
}
