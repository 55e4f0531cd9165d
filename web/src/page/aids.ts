// The maps over the pictures: a section of the panel, which is filled when it is first wanted, and what the panes draw.

import { section } from "./fields.ts";
import type { CaseMaps } from "./case-maps.ts";
import { later } from "./later.ts";
import type { MapsSection } from "./maps-section.ts";
import type { Actions } from "./actions.ts";
import { h } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import type { ReadyCase } from "../model/case.ts";
import type { MapName } from "../model/maps.ts";
import type { ViewState } from "../model/state.ts";
import type { Block } from "../model/wire.ts";

export interface AidsListener {
  readonly actions: Actions;
  /** What can be drawn has changed. */
  redraw(): void;
  complain(problem: unknown): void;
}

interface Filled {
  readonly maps: CaseMaps;
  readonly section: MapsSection;
}

export class Aids {
  readonly element = section(t("panel.maps"), true);
  readonly #shown: ReadyCase;
  readonly #listener: AidsListener;
  #filling: Promise<Filled> | null = null;
  #filled: Filled | null = null;
  #state: ViewState | null = null;
  #isGone = false;

  constructor(shown: ReadyCase, listener: AidsListener) {
    this.#shown = shown;
    this.#listener = listener;
    this.element.classList.add("maps");
    this.element.querySelector(".group-body")?.append(h("p", { class: "quiet" }, "…"));
  }

  /** Fills the section. */
  load(): Promise<Filled> {
    const filling = (this.#filling ??= this.#fill());
    // It is tried again when it is wanted again.
    filling.catch(() => (this.#filling = null));
    return filling;
  }

  show(state: ViewState): void {
    const isNew = state.overlay?.name !== this.#state?.overlay?.name;
    this.#state = state;
    this.#filled?.section.show(state);
    if (!state.overlay || !isNew) return;
    const ask = async (): Promise<void> => (await this.load()).maps.ask();
    ask().catch((problem: unknown) => this.#listener.complain(problem));
  }

  /** The state as it can be drawn by now: without a map that is not ready. */
  drawable(state: ViewState): ViewState {
    return state.overlay && !this.#filled?.maps.isReady ? { ...state, overlay: null } : state;
  }

  async layer(name: MapName): Promise<Block> {
    return (await this.load()).maps.layer(name);
  }

  dispose(): void {
    this.#isGone = true;
    this.#filled?.maps.dispose();
  }

  async #fill(): Promise<Filled> {
    const parts = await later();
    const maps = new parts.CaseMaps(this.#shown.id, (now) => {
      made.tell(now);
      this.#listener.redraw();
    });
    const made = new parts.MapsSection(this.#shown, maps, this.#listener.actions);
    this.#filled = { maps, section: made };
    if (this.#isGone) maps.dispose();
    this.element.querySelector(".group-body")?.replaceWith(made.element);
    if (this.#state) made.show(this.#state);
    return this.#filled;
  }
}
