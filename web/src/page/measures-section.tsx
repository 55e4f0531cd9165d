// The section of the panel with the ruler: what is measured in the panes, until it is removed.

import { useLayoutEffect, useRef } from "preact/hooks";

import { number, t } from "../base/i18n.ts";
import { type Column, TOOLS, type Values } from "../model/measure.ts";
import { mayWrite } from "../store/holder.ts";
import { type Measured, columnWords, wordsOf } from "../store/measures.ts";
import { Button, Buttons, IconButton, Line, type OfStore, Quiet, Row, Section } from "./fields.tsx";

/** What can be measured, and by which keys. */
export function RulerControls({ store: { measures, looks, task } }: OfStore) {
  const tool = measures.tool.value;
  return (
    <>
      <Buttons
        name="rulers"
        label={t("panel.measure")}
        values={TOOLS}
        value={tool}
        words={(one) => t(`measure.${one}`)}
        onChoose={(one) => {
          measures.choose(one === tool ? null : one);
          document.getElementById("menu-ruler")?.hidePopover();
          if (!measures.isOn) return;
          // What to do next, and what comes of it, stands there.
          task.value = "read";
          looks.value += 1;
        }}
      />
      <Quiet>{measures.hint.value}</Quiet>
      <p class="quiet keys">{t("measure.keys")}</p>
    </>
  );
}

/** What to do next, and what was measured; nothing as long as nobody measures. */
export function MeasuresSection({ store: { measures }, store }: OfStore) {
  const tool = measures.tool.value;
  const list = measures.list.value;
  const hint = useRef<HTMLParagraphElement>(null);
  useLayoutEffect(() => {
    if (tool) hint.current?.closest("details")?.setAttribute("open", "");
  }, [tool]);
  if (!tool && list.length === 0) return null;
  return (
    <Section title="panel.measure" data-task="read">
      <p class="quiet" role="status" ref={hint}>
        {measures.hint.value}
      </p>
      <Row>
        {measures.canEnd.value && <Button onClick={() => measures.end()}>{t("measure.finish")}</Button>}
        {measures.count.value > 0 && (
          <Button aria-keyshortcuts="Backspace" onClick={() => measures.takeBack()}>
            {t("measure.back")}
          </Button>
        )}
      </Row>
      <ol class="measures">
        {list.map((measured) => (
          <Item key={measured.measure.id} store={store} measured={measured} />
        ))}
      </ol>
      <Row>
        <Button disabled={list.length === 0} onClick={() => (measures.list.value = [])}>
          {t("measure.clear")}
        </Button>
      </Row>
    </Section>
  );
}

function Item({ store, measured }: OfStore & { readonly measured: Measured }) {
  const { measures } = store;
  const { measure, values, column } = measured;
  const words = wordsOf(measured);
  const isKept = measures.isKept(measured);
  const keep = t(isKept ? "measure.kept" : "measure.keep");
  return (
    <li data-tool={measure.tool}>
      <span class="value">{words}</span>
      {values.along_mm !== undefined && <Quiet>{t("measure.straight", lengthsOf(values))}</Quiet>}
      {column && <Depths store={store} measured={measured} between={column.between} />}
      <Row>
        <Button
          disabled={isKept || !mayWrite.value}
          aria-label={`${words}: ${keep}`}
          onClick={() => measures.keep(measured)}
        >
          {keep}
        </Button>
        <IconButton
          icon="trash"
          label={t("findings.remove", { name: words })}
          onClick={() => measures.remove(measured)}
        />
      </Row>
    </li>
  );
}

/** The depths of the column below an area, to be changed. */
function Depths({ store, measured, between }: OfStore & { readonly measured: Measured; readonly between: Column }) {
  const most = Math.floor(store.shown.max_depth_mm);
  return (
    <div class="column">
      <Line label={t("measure.column")} data-id={measured.measure.id}>
        {([0, 1] as const).map((at) => (
          <input
            key={at}
            type="number"
            min={0}
            max={most}
            step={0.5}
            value={between[at]}
            aria-label={t(at === 0 ? "measure.column-from" : "measure.column-to")}
            onChange={({ currentTarget: { valueAsNumber } }) => {
              const [from, to] = between.with(at, valueAsNumber || 0);
              store.measures.bound(measured, [from ?? 0, to ?? 0]);
            }}
          />
        ))}
        <span class="quiet" aria-hidden="true">
          mm
        </span>
      </Line>
      <Quiet>{columnWords(measured)}</Quiet>
    </div>
  );
}

const lengthsOf = ({ straight_mm = NaN, along_mm = NaN }: Values) => ({
  straight: number(straight_mm, 1),
  along: number(along_mm, 1),
});
