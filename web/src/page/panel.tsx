// The visible controls: everything that hands and keys do can be done here as well.

import { effect } from "@preact/signals";
import { render } from "preact";

import { h } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { TASKS, choose, preferences } from "../store/preferences.ts";
import { CaseSection, type Made } from "./case-section.tsx";
import { ChecklistSection } from "./checklist-section.tsx";
import { DrawingSection } from "./drawing-section.tsx";
import type { OnScreen } from "./export.ts";
import { ExportSection } from "./export-section.tsx";
import { Buttons, type OfStore } from "./fields.tsx";
import { FindingsSection } from "./findings-section.tsx";
import { LayersSection } from "./layers-section.tsx";
import { LayoutsSection } from "./layouts-section.tsx";
import { MapsSection } from "./maps-section.tsx";
import { MeasuresSection } from "./measures-section.tsx";
import { PointSection } from "./point-section.tsx";
import { SweepSection } from "./sweep-section.tsx";
import { ViewSection } from "./view-section.tsx";
import { WindowSection } from "./window-section.tsx";

interface PanelProps extends OfStore {
  readonly made: Made;
  onScreen(): OnScreen;
}

/** The panel beside the picture. */
export class Panel {
  readonly element = h("aside", { class: "panel", "aria-label": t("panel.label") });
  readonly #ends: readonly (() => void)[];

  constructor(props: PanelProps) {
    const { task, status } = props.store;
    render(<Sections {...props} />, this.element);
    this.#ends = [
      effect(() => {
        this.element.hidden = !preferences.value.panel;
        this.element.dataset.way = status.value?.way ?? "";
      }),
      effect(() => {
        this.element.dataset.task = task.value;
        // A task that is all folded would show nothing.
        const own = [...this.element.querySelectorAll<HTMLDetailsElement>(`:scope > [data-task~=${task.value}]`)];
        if (own[0] && own.every(({ open }) => !open)) own[0].open = true;
      }),
    ];
  }

  dispose(): void {
    for (const end of this.#ends) end();
    render(null, this.element);
    this.element.remove();
  }
}

/** The sections, in the order of a reading: where to look, what is there, what is written down, how it is shown. */
function Sections({ store, made, onScreen }: PanelProps) {
  return (
    <>
      <Buttons
        name="tasks"
        label={t("task.label")}
        values={TASKS}
        value={store.task.value}
        words={(one) => t(`task.${one}`)}
        onChoose={(task) => {
          store.task.value = task;
          choose({ task });
        }}
      />
      <MapsSection store={store} />
      <PointSection store={store} />
      <FindingsSection store={store} />
      <MeasuresSection store={store} />
      <ChecklistSection store={store} />
      <LayoutsSection store={store} />
      <WindowSection store={store} />
      <LayersSection store={store} />
      <ViewSection store={store} />
      <DrawingSection store={store} />
      <CaseSection store={store} made={made} />
      <SweepSection store={store} />
      <ExportSection store={store} onScreen={onScreen} />
    </>
  );
}
