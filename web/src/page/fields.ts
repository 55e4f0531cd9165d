// The parts that panels are made of.

import { type Child, h } from "../base/dom.ts";

export const button = (words: Child, onClick: () => void, attributes: Record<string, string> = {}): HTMLButtonElement =>
  h("button", { type: "button", click: onClick, ...attributes }, words);

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
