// The places of a list as a table: a row for each, and below the open one what is known of it.

import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";

import { gyrusWords, number, t } from "../base/i18n.ts";
import { positionWords } from "../base/readout.ts";
import { JUDGEMENTS, type Judgement, findingOfPlace } from "../model/findings.ts";
import { keyOf } from "../model/keys.ts";
import { type Candidate, type ListingMap, standsOut } from "../model/maps.ts";
import { mirrorPlane, reflected } from "../model/midsagittal.ts";
import { WHY_PARTS, type Why, whyAt } from "../model/why.ts";
import { goToPlace } from "../store/bring.ts";
import type { PlacesOfMap } from "../store/places.ts";
import type { Store } from "../store/store.ts";
import { Chart } from "./chart.tsx";
import { Button, Buttons, Line, type OfStore, Quiet, Writing } from "./fields.tsx";

/** A bar of this score is as wide as its column. */
const WIDEST_SCORE: Readonly<Record<ListingMap, number>> = { blur: 4, thickness: 8, flair: 4 };
const COLUMNS = ["rank", "side", "gyrus", "depth", "score", "seen"] as const;

interface OfList extends OfStore {
  readonly list: PlacesOfMap;
}

/** What a reader has decided about a place. */
function judgementOf({ findings }: Store, place: Candidate): Judgement | null {
  const finding = findingOfPlace(findings.list.value, place.position_in_patient);
  return finding ? (finding.is_dismissed ? "dismissed" : "kept") : null;
}

export function PlacesTable({ store, list, label }: OfList & { readonly label: string }) {
  const { candidates, inSight } = list;
  const open = list.open.value;
  const isUnfolded = list.isUnfolded.value;
  const count = number(candidates.filter((place) => !standsOut(place)).length);
  // Without an atlas no place has a name, and the column no place.
  const isNamed = candidates.some(({ gyrus }) => gyrusWords(gyrus) !== "");
  return (
    <div class="places">
      <table class={isNamed ? "candidates named" : "candidates"} aria-label={label} hidden={inSight.length === 0}>
        <thead>
          <tr>
            {COLUMNS.map((name) => (
              <th key={name} scope="col" class={name}>
                {t(name === "gyrus" ? "gyrus.about" : `places.${name}`)}
              </th>
            ))}
          </tr>
        </thead>
        <tbody onKeyDown={walk}>
          {candidates.map((place, at) => (
            <Place
              key={place}
              store={store}
              list={list}
              place={place}
              at={at}
              isHidden={!inSight.includes(place)}
              // The table is one stop of the tabulator.
              isStop={place === (open ?? inSight[0])}
            />
          ))}
        </tbody>
      </table>
      {!candidates.every(standsOut) && (
        <Button class="fold" aria-expanded={isUnfolded} onClick={() => store.places.unfold(list)}>
          {t(isUnfolded ? "places.fold" : "places.unfold", { count })}
        </Button>
      )}
    </div>
  );
}

function Place({
  store,
  list,
  place,
  at,
  isHidden,
  isStop,
}: OfList & { readonly place: Candidate; readonly at: number; readonly isHidden: boolean; readonly isStop: boolean }) {
  const { places } = store;
  const row = useRef<HTMLTableRowElement>(null);
  const reached = places.reached.value;
  useLayoutEffect(() => {
    if (reached === place) row.current?.scrollIntoView({ block: "nearest" });
  }, [reached]);
  const { side, depth_mm, score, unusual } = place;
  const gyrus = gyrusWords(place.gyrus);
  const where = [t(`side.${side}`), gyrus].filter(Boolean).join(" ");
  const depth = depth_mm === null ? "–" : number(depth_mm, 1);
  const isOpen = place === list.open.value;
  const isSeen = places.isSeen(place);
  const judgement = judgementOf(store, place);
  const about = t(`places.${judgement ?? (isSeen ? "looked-at" : "not-yet")}`);
  return (
    <>
      <tr
        ref={row}
        class="place"
        hidden={isHidden}
        aria-current={isOpen}
        data-judgement={judgement ?? ""}
        onClick={() => goToPlace(store, list, place)}
      >
        <td>
          {/* The row's own click follows. */}
          <Button
            class="candidate"
            aria-label={t("candidates.place", { rank: number(at + 1), side: where, depth })}
            aria-keyshortcuts=", ."
            tabIndex={isStop ? 0 : -1}
          >
            {number(at + 1)}
          </Button>
        </td>
        <td>{t(`side.${side}`)}</td>
        <td class="gyrus" title={gyrus}>
          {gyrus || "–"}
        </td>
        <td>{depth_mm === null ? depth : `${depth} mm`}</td>
        <td class="score">
          <span
            class="score-bar"
            aria-hidden="true"
            style={{ width: `${100 * Math.min(score / WIDEST_SCORE[list.map], 1)}%` }}
          />
          <span>{t(`unusual.${unusual ?? "no"}`, { score: number(score, 1) })}</span>
        </td>
        <td>
          <span class={isSeen ? "dot filled" : "dot"} role="img" aria-label={about} title={about} />
        </td>
      </tr>
      {isOpen && <Details store={store} list={list} place={place} isHidden={isHidden} />}
    </>
  );
}

/** What is known of the open place, and what a reader can do about it. */
function Details({ store, list, place, isHidden }: OfList & { readonly place: Candidate; readonly isHidden: boolean }) {
  const { position_in_patient, score, size_mm } = place;
  const judgement = judgementOf(store, place);
  const facts = t("candidates.facts", { score: number(score, 1), size: number(size_mm, 1) });
  return (
    <tr class="why" hidden={isHidden}>
      <td colSpan={COLUMNS.length}>
        <Quiet>{`${facts} · ${positionWords(position_in_patient)}`}</Quiet>
        <Writing>
          <Buttons
            label={t("places.decision")}
            values={JUDGEMENTS}
            value={judgement}
            words={(one) => t(one === "kept" ? "places.keep" : "places.dismiss")}
            about={(one) => ({ title: keyOf((command) => command.kind === "judge" && command.judgement === one) })}
            onChoose={(one) => store.findings.judge(place, judgement === one ? null : one, list.map)}
          />
        </Writing>
        {/* The sharpness of the boundary says nothing about the other maps. */}
        <div class="why-bars">{list.map === "blur" && <WhyBars store={store} place={place} />}</div>
        <div class="place-chart">
          <Chart store={store} />
        </div>
      </td>
    </tr>
  );
}

/** How sharp the junction is at a place and around it, once the map is here: bars of one scale. */
function WhyBars({ store, place }: OfStore & { readonly place: Candidate }) {
  const [why, setWhy] = useState<Why | null>(null);
  useEffect(() => {
    const { position_in_patient } = place;
    const opposite = reflected(position_in_patient, mirrorPlane(store.shown));
    store.caseLayers.voxels("sharpness").then(
      (sharpness) => setWhy(whyAt(sharpness, position_in_patient, opposite)),
      () => {},
    );
  }, [place]);
  if (!why) return null;
  const most = Math.max(...Object.values(why).filter(Number.isFinite), 1e-9);
  return (
    <>
      <Quiet>{t("why.title")}</Quiet>
      {WHY_PARTS.map((part) => {
        const value = why[part];
        const words = Number.isFinite(value) ? `${number(value, 2)} /mm` : "–";
        const label = t(`why.${part}`);
        return (
          <Line key={part} label={label}>
            <meter value={Number.isFinite(value) ? value / most : 0} aria-label={`${label}: ${words}`} />
            <span class="value quiet" aria-hidden="true">
              {words}
            </span>
          </Line>
        );
      })}
    </>
  );
}

/** Arrows go from row to row. */
function walk(event: KeyboardEvent & { readonly currentTarget: HTMLElement }): void {
  const steps = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  const rows = [...event.currentTarget.querySelectorAll<HTMLElement>("tr.place:not([hidden])")];
  const at = rows.findIndex((one) => one.contains(document.activeElement));
  if (steps === undefined || at < 0 || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  event.stopPropagation();
  rows[Math.min(Math.max(at + steps, 0), rows.length - 1)]?.querySelector("button")?.focus();
}
