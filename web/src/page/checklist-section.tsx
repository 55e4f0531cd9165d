// The section of the panel that says which parts of the head were looked at, and for how long. It stays in the page.

import { useSignalEffect } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";

import { number, t } from "../base/i18n.ts";
import { BANDS_MM, Checklist, LOBES, LOOKS, type LobeSide, type Look } from "../model/checklist.ts";
import { choose } from "../store/preferences.ts";
import { canShow, protocolNow, protocols, stepOnScreen, stepWords, stepsNow, takeStep } from "../store/steps.ts";
import type { Store } from "../store/store.ts";
import { Button, ChoiceLine, type OfStore, Quiet, Row, Section } from "./fields.tsx";

/** How often what is shown is written again, in ms. */
const TICK_MS = 1000;
/** A look of so many seconds fills a cell's bar. */
const FULL_S = 30;
const SIDES = ["left", "right"] as const;

/** What was looked at, by case, as long as the page is open. */
const LISTS = new Map<string, Checklist>();

const lookName = (look: Look): string => t(look === "slices" || look === "closer" ? `looked.${look}` : `view.${look}`);

/** Where the mark is, if the server knows. */
function lobeOf({ point }: Store): LobeSide | null {
  const { lobe, side } = point.measured.value?.own ?? {};
  const known = LOBES.find((one) => one === lobe);
  return known && side ? `${known} ${side}` : null;
}

export function ChecklistSection({ store }: OfStore) {
  const { id } = store.shown;
  const list = LISTS.get(id) ?? new Checklist();
  LISTS.set(id, list);
  const table = useRef<HTMLTableElement>(null);
  const [hasLobes, setHasLobes] = useState(false);
  const [, write] = useState(0);
  const look = (): void =>
    list.show(document.hidden ? null : store.view.state.value, performance.now(), lobeOf(store), stepOnScreen(store));
  useSignalEffect(() => {
    look();
    if (lobeOf(store)) setHasLobes(true);
  });
  useEffect(() => {
    const timer = setInterval(() => {
      // Nobody sees a section that is closed.
      if (table.current?.offsetParent === null) return;
      look();
      write(performance.now());
    }, TICK_MS);
    document.addEventListener("visibilitychange", look);
    return () => {
      clearInterval(timer);
      document.removeEventListener("visibilitychange", look);
      list.show(null, performance.now(), null);
    };
  }, []);
  const bands = BANDS_MM.map((band, at) => {
    const to = BANDS_MM[at + 1];
    return { band, depths: to === undefined ? `> ${number(band)}` : `${number(band)}–${number(to)}` };
  });
  const cell = (...[look, band]: Parameters<Checklist["seconds"]>) => {
    const seconds = list.seconds(look, band);
    const share = `${100 * Math.min(seconds / FULL_S, 1)}%`;
    return (
      <td class={seconds > 0 ? "seen" : ""} style={{ "--share": share }}>
        {seconds > 0 ? `${number(seconds)} s` : "–"}
      </td>
    );
  };
  return (
    <Section title="panel.checklist" data-task="read">
      <ChoiceLine
        id="protocol"
        label={t("step.protocol")}
        values={protocols()}
        value={protocolNow()}
        words={(one) => t(`protocol.${one}`)}
        onChoose={(protocol) => choose({ protocol })}
      />
      <ol class="steps">
        {stepsNow().map((step) => {
          const words = stepWords(step);
          const isLooked = list.hasStep(step.name);
          return (
            <li key={step.name} class={isLooked ? "seen" : undefined}>
              <Button
                aria-current={step.name === store.step.value ? "step" : undefined}
                aria-label={isLooked ? `${words}, ${t("places.looked-at")}` : words}
                disabled={!canShow(store, step)}
                onClick={() => void takeStep(store, step)}
              >
                {words}
              </Button>
            </li>
          );
        })}
      </ol>
      <p class="quiet keys">{t("step.keys")}</p>
      <table class="checklist" aria-label={t("panel.checklist")} ref={table}>
        <thead>
          <tr>
            <th scope="col">{t("checklist.depth")}</th>
            {LOOKS.map((one) => (
              <th key={one} scope="col" title={lookName(one)}>
                {t(`letter.${one}`)}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {bands.map(({ band, depths }) => (
            <tr key={band}>
              <th scope="row">{depths}</th>
              {LOOKS.map((one) => cell(one, band))}
            </tr>
          ))}
        </tbody>
      </table>
      <Quiet>{t("checklist.about")}</Quiet>
      {hasLobes && (
        <div class="by-lobe">
          <table class="checklist" aria-label={t("checklist.lobes")}>
            <thead>
              <tr>
                <th scope="col" colSpan={2}>
                  {t("checklist.depth")}
                </th>
                {bands.map(({ depths }) => (
                  <th key={depths} scope="col">
                    {depths}
                  </th>
                ))}
              </tr>
            </thead>
            {LOBES.map((lobe) => (
              <tbody key={lobe}>
                {SIDES.map((side, at) => (
                  <tr key={side}>
                    {at === 0 && (
                      <th scope="rowgroup" rowSpan={SIDES.length}>
                        {t(`lobe.${lobe}`)}
                      </th>
                    )}
                    <th scope="row" title={t(`view.${side}`)}>
                      {t(`letter.${side}`)}
                    </th>
                    {bands.map(({ band }) => cell(`${lobe} ${side}`, band))}
                  </tr>
                ))}
              </tbody>
            ))}
          </table>
          <Quiet>{t("checklist.about-lobes")}</Quiet>
        </div>
      )}
      <Row>
        <Button
          onClick={() => {
            list.clear();
            store.step.value = null;
            write(performance.now());
          }}
        >
          {t("checklist.clear")}
        </Button>
      </Row>
    </Section>
  );
}
