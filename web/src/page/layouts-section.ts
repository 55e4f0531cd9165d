// The section of the panel with the layouts that a reader has saved, in this browser.

import { h, iconButton, quiet, tell } from "../base/dom.ts";
import { number, t } from "../base/i18n.ts";
import type { ReadyCase } from "../model/case.ts";
import {
  LONGEST_NAME,
  MOST_LAYOUTS,
  type SavedLayout,
  boundName,
  readLayouts,
  recalled,
  savedAs,
} from "../model/saved-layouts.ts";
import type { ViewState } from "../model/state.ts";
import type { Actions } from "./actions.ts";
import { button, row } from "./fields.ts";

const KEY = "isocortex-layouts";

interface LayoutsHost {
  readonly shown: ReadyCase;
  readonly actions: Pick<Actions, "change" | "command">;
  state(): ViewState;
  announce(words: string): void;
}

/** A browser may forbid to store anything: then layouts last as long as the page is open. */
let unstored: readonly SavedLayout[] = [];

function stored(): readonly SavedLayout[] {
  try {
    return readLayouts(localStorage.getItem(KEY));
  } catch {
    return unstored;
  }
}

export class LayoutsSection {
  readonly element: HTMLElement;
  readonly #host: LayoutsHost;
  readonly #list = h("ol", { class: "saved-layouts" });
  readonly #status = h("p", { class: "quiet", role: "status", hidden: true });
  readonly #name = h("input", {
    type: "text",
    id: "layout-name",
    maxlength: LONGEST_NAME,
    dir: "auto",
    autocomplete: "off",
    placeholder: t("layouts.name"),
    "aria-label": t("layouts.name"),
    keydown: ({ key }: KeyboardEvent) => {
      if (key === "Enter") this.#save();
    },
  });
  /** Another window has saved one. */
  readonly #hear = ({ key }: StorageEvent): void => {
    if (key === KEY) this.#show();
  };

  constructor(host: LayoutsHost) {
    this.#host = host;
    const save = button(t("layouts.save"), () => this.#save());
    this.element = h(
      "div",
      { class: "group-body" },
      this.#list,
      row(this.#name, save),
      this.#status,
      quiet(t("layouts.about")),
      h("p", { class: "quiet keys" }, t("layouts.keys")),
    );
    addEventListener("storage", this.#hear);
    this.#show();
  }

  /** Shows the layout of a number from 1. */
  recall(at: number): void {
    const saved = stored()[at - 1];
    if (!saved) return this.#host.announce(t("layouts.none", { number: number(at) }));
    const state = this.#host.state();
    // A close-up needs a mark, and comes with the panes as they are before it.
    if (saved.layout === "closer" && !state.crosshair_mm) return this.#host.announce(t("closer.unmarked"));
    this.#host.actions.change(recalled(saved, state, this.#host.shown), true);
    this.#host.announce(t("layouts.shown", { name: saved.name }));
  }

  dispose(): void {
    removeEventListener("storage", this.#hear);
  }

  #save(): void {
    const name = boundName(this.#name.value);
    const others = stored().filter((one) => one.name !== name);
    const before = stored().findIndex((one) => one.name === name);
    if (name === "") return tell(this.#status, t("layouts.unnamed"));
    if (before < 0 && others.length >= MOST_LAYOUTS) return tell(this.#status, t("layouts.full"));
    const saved = savedAs(name, this.#host.state());
    // Of the same name, in the same place.
    this.#store(before < 0 ? [...others, saved] : others.toSpliced(before, 0, saved));
    this.#name.value = "";
    tell(this.#status, t("layouts.saved", { name }));
  }

  #store(layouts: readonly SavedLayout[]): void {
    unstored = layouts;
    try {
      localStorage.setItem(KEY, JSON.stringify(layouts));
    } catch {
      // They last until the page is closed, then.
    }
    this.#show();
  }

  #show(): void {
    const layouts = stored();
    this.#list.replaceChildren(
      ...layouts.map(({ name }, at) => {
        const go = button(name, () => this.recall(at + 1), { dir: "auto", "aria-keyshortcuts": `g ${at + 1}` });
        const remove = iconButton("trash", t("findings.remove", { name }), () =>
          this.#store(stored().filter((_, other) => other !== at)),
        );
        return h("li", {}, h("kbd", {}, `g ${number(at + 1)}`), go, remove);
      }),
    );
  }
}
