// The panel beside the pictures: its tabs, and the sections of each.

import { useLayoutEffect, useRef } from "preact/hooks";

import { t } from "../base/i18n.ts";
import { TASKS, choose, preferences } from "../store/preferences.ts";
import { CaseSection, type Made } from "./case-section.tsx";
import { ChecklistSection } from "./checklist-section.tsx";
import type { OnScreen } from "./export.ts";
import { Buttons, type OfStore } from "./fields.tsx";
import { LayersSection } from "./layers-section.tsx";
import { LayoutsSection } from "./layouts-section.tsx";
import { ListSection } from "./list-section.tsx";
import { MeasuresSection } from "./measures-section.tsx";
import { PointSection } from "./point-section.tsx";
import { ReadingSection } from "./reading-section.tsx";
import { ResultsSection } from "./results-section.tsx";
import { DrawingSection, ViewSection } from "./view-section.tsx";

interface PanelProps extends OfStore {
  readonly made: Made;
  onScreen(): OnScreen;
}

/** The panel beside the picture: its sections in the order of a reading. */
export function Panel({ store, made, onScreen }: PanelProps) {
  const panel = useRef<HTMLElement>(null);
  const task = store.task.value;
  useLayoutEffect(() => {
    // A task that is all folded would show nothing.
    const own = [...(panel.current?.querySelectorAll<HTMLDetailsElement>(`:scope > [data-task~=${task}]`) ?? [])];
    if (own[0] && own.every(({ open }) => !open)) own[0].open = true;
  }, [task]);
  return (
    <aside
      class="panel"
      aria-label={t("panel.label")}
      hidden={!preferences.value.panel}
      data-way={store.status.value?.way ?? ""}
      data-task={task}
      ref={panel}
    >
      <Buttons
        name="tasks"
        label={t("task.label")}
        values={TASKS}
        value={task}
        words={(one) => t(`task.${one}`)}
        onChoose={(one) => {
          store.task.value = one;
          choose({ task: one });
        }}
      />
      <ListSection store={store} />
      <ReadingSection store={store} />
      <PointSection store={store} />
      <MeasuresSection store={store} />
      <ChecklistSection store={store} />
      <LayoutsSection store={store} />
      <ViewSection store={store} />
      <LayersSection store={store} />
      <DrawingSection store={store} />
      <CaseSection store={store} made={made} />
      <ResultsSection store={store} onScreen={onScreen} />
    </aside>
  );
}
