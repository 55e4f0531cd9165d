// What the frame of the page, the list and the dialogs are made of.

import { type Child, h } from "../base/dom.ts";

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

/** Buttons side by side. */
export const row = (...children: Child[]): HTMLElement => h("div", { class: "row" }, ...children);

/** Marks the chosen one of a group of buttons. */
export function press(group: HTMLElement, value: string | null): void {
  for (const one of group.querySelectorAll("button")) one.setAttribute("aria-pressed", String(one.value === value));
}
