// The one list of a reading: the places to look at and the findings, what is known of each, and what a reader writes about it.

import { type Vec3, clamp } from "../model/space.ts";
import type { Store } from "../store/store.ts";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";

import { reasonIn } from "../base/case-words.ts";
import { gyrusWords, number, t } from "../base/i18n.ts";
import { positionWords } from "../base/readout.ts";
import {
  CERTAINTIES,
  type Finding,
  JUDGEMENTS,
  type Judgement,
  LONGEST_LABEL,
  LONGEST_NOTE,
  middleOf,
  numbered,
} from "../model/findings.ts";
import { findingAddress } from "../model/fragment.ts";
import { keyOf } from "../model/keys.ts";
import { type Candidate, type ListingMap, type Standard, standsOut } from "../model/maps.ts";
import { reflected, sideOf } from "../model/midsagittal.ts";
import { plainLine } from "../model/text.ts";
import { WHY_PARTS, type Why, whyAt } from "../model/why.ts";
import { goToRow } from "../store/bring.ts";
import { mayWrite } from "../store/holder.ts";
import { LIST_WORDS, type PlacesOfMap } from "../store/places.ts";
import { choose, preferences } from "../store/preferences.ts";
import type { Row as ListRow } from "../store/rows.ts";
import { Chart } from "./chart.tsx";
import { copied } from "./export.ts";
import {
  Bar,
  Button,
  Buttons,
  Choice,
  IconButton,
  Line,
  type OfStore,
  Quiet,
  Row,
  Section,
  Status,
  Ticked,
  Typed,
  Writing,
  Written,
} from "./fields.tsx";
import { FindingFiles } from "./findings-files.tsx";

/** A bar of this score is as wide as its column. */
const WIDEST_SCORE: Readonly<Record<ListingMap, number>> = { blur: 4, thickness: 8, flair: 4 };

interface OfRow extends OfStore {
  readonly row: ListRow;
}
interface OfFinding extends OfStore {
  readonly finding: Finding;
  /** What it is called. */
  readonly name: string;
}

export function ListSection({ store }: OfStore) {
  const { findings, places, rows } = store;
  const inSight = rows.inSight.value;
  const numbers = new Map(numbered(findings.list.value).map(({ id }, at) => [id, at + 1]));
  const known = rows.all.value.flatMap(({ place }) => place ?? []);
  const out = known.filter(standsOut).length;
  // The list is one stop of the tabulator.
  const stop = inSight.find(({ key }) => key === rows.open.value?.key) ?? inSight[0];
  return (
    <Section title="panel.list" data-task="read">
      {known.length > 0 && (
        <Quiet>
          {t("list.summary", { out: number(out), more: number(known.length - out), kept: number(numbers.size) })}
        </Quiet>
      )}
      <Status id="maps-status" words={places.said.value} />
      {places.lists.map((list) => (
        <AboutPlaces key={list.map} store={store} list={list} />
      ))}
      <Status id="findings-status" words={findings.status.value} />
      <Status class="doubtful" words={findings.doubled.value} />
      {!mayWrite.value && <Quiet>{t("findings.read-only")}</Quiet>}
      <ol class="rows" aria-label={t("panel.list")} onKeyDown={walk}>
        {inSight.map((row) => (
          <Item
            key={row.key}
            store={store}
            row={row}
            at={numbers.get(row.finding?.id ?? "") ?? null}
            isStop={row.key === stop?.key}
          />
        ))}
      </ol>
      {places.lists.map((list) => (
        <Fold key={list.map} list={list} />
      ))}
      <Writing>
        <Button onClick={() => findings.add()}>{t("findings.add")}</Button>
      </Writing>
      <Line label={t("findings.reader")}>
        <Typed
          id="reader"
          maxLength={LONGEST_LABEL}
          value={preferences.value.reader}
          dir="auto"
          autocomplete="off"
          aria-label={t("findings.reader")}
          onLeave={(typed) => {
            const reader = plainLine(typed, LONGEST_LABEL);
            choose({ reader });
            store.findings.signOwn();
            return reader;
          }}
        />
      </Line>
      <FindingFiles store={store} />
    </Section>
  );
}

/** A button that asks for the places of a map; then, what there is to say about them. */
function AboutPlaces({ store, list }: OfStore & { readonly list: PlacesOfMap }) {
  const layers = store.caseLayers.list.value?.layers;
  const isFlair = list.map === "flair";
  const map = isFlair ? layers?.find(({ id }) => id === "flair") : layers?.[0];
  if (isFlair && !map) return null;
  const words = LIST_WORDS[list.map];
  const found = list.list.value;
  if (!found) {
    const isOff = map?.state === "undefined" || map?.state === "off";
    return (
      <>
        <Button
          aria-describedby="maps-status"
          disabled={list.isAsking.value || isOff}
          onClick={() => void store.places.ask(list).then(() => requestAnimationFrame(enterList))}
        >
          {t(words.ask)}
        </Button>
        <Status words={isFlair ? store.caseLayers.whyNone("flair") : ""} />
      </>
    );
  }
  const { state, reasons, reason_codes } = found.regions;
  return (
    <>
      <Status class="nothing" words={list.nothingWords} />
      {state === "review" && (
        <p class="quiet regions-doubt">
          {t("regions.doubt", { reason: reasonIn(reasons[0] ?? "", reason_codes[0] ?? "") })}
        </p>
      )}
      {list.candidates.length > 0 && (
        <details class="candidates-warning">
          <summary>{`${t(`map.${list.map}`)}: ${t("candidates.normal")}`}</summary>
          <Quiet>{`${t(words.warning)} ${t("candidates.score-about")}`}</Quiet>
        </details>
      )}
    </>
  );
}

/** The button that asked for the list is gone: the focus goes to the first row, unless it is elsewhere by now. */
function enterList(): void {
  if (document.activeElement !== document.body) return;
  document.querySelector<HTMLElement>(".rows .row-button[tabindex='0'], .fold")?.focus({ preventScroll: true });
}

/** Shows the places of a map that do not stand out, or folds them again. */
function Fold({ list }: { readonly list: PlacesOfMap }) {
  const isUnfolded = list.isUnfolded.value;
  const count = list.candidates.filter((place) => !standsOut(place)).length;
  return count === 0 ? null : (
    <Button class="fold" aria-expanded={isUnfolded} onClick={() => (list.isUnfolded.value = !isUnfolded)}>
      {`${t(`map.${list.map}`)}: ${t(isUnfolded ? "places.fold" : "places.unfold", { count: number(count) })}`}
    </Button>
  );
}

const nounOf = ({ kind }: Finding): string => (kind === "point" ? "" : t(`findings.${kind}`));

/** A row of the list; `at` is the number of its finding, null: it is none, or dismissed. */
function Item({ store, row, at, isStop }: OfRow & { readonly at: number | null; readonly isStop: boolean }) {
  const { findings, places, rows, shown } = store;
  const { key, list, place, finding } = row;
  const item = useRef<HTMLLIElement>(null);
  const isOpen = rows.open.value?.key === key;
  const reached = rows.reached.value;
  useLayoutEffect(() => {
    if (reached === key) item.current?.scrollIntoView({ block: "nearest" });
  }, [reached]);
  // A new finding is written about at once, in sight.
  useLayoutEffect(() => {
    if (!finding || findings.written.value !== finding.id) return;
    findings.written.value = null;
    item.current?.closest("details")?.setAttribute("open", "");
    item.current?.querySelector<HTMLElement>(".finding-label")?.focus();
  }, [findings.written.value, isOpen]);
  const judgement = judgementOf(row);
  const side = place?.side ?? finding?.side ?? (finding && sideOf(middleOf(finding), shown.midsagittal)) ?? "unknown";
  const gyrus = gyrusWords(place?.gyrus ?? finding?.gyrus);
  const titled = (sideWords: string): string =>
    [finding && nounOf(finding), sideWords, gyrus].filter(Boolean).join(" ");
  const title = titled(t(`side.${side}`));
  // Before the name of a gyrus, the letter leaves room for it.
  const hasLetter = gyrus !== "" && (side === "left" || side === "right");
  const depth_mm = place?.depth_mm ?? finding?.depth_mm ?? null;
  const depth = depth_mm === null ? "–" : `${number(depth_mm, 1)} mm`;
  const score = place && t(`unusual.${place.unusual ?? "no"}`, { score: number(place.score, 1) });
  const about = [
    finding?.is_unconfirmed && t("findings.unconfirmed"),
    finding?.label,
    list && `${t(`map.${list.map}`)} ${score}`,
  ];
  const state = t(`places.${judgement ?? (place && places.isSeen(place) ? "looked-at" : "not-yet")}`);
  const name = [
    at === null ? (judgement === "dismissed" ? t("findings.dismissed") : "") : number(at),
    title,
    depth,
  ].filter(Boolean);
  return (
    <li ref={item} data-id={finding?.id} data-judgement={judgement ?? ""} aria-current={isOpen}>
      <Button
        class="row-button"
        aria-expanded={isOpen}
        aria-keyshortcuts=", . Shift+U Shift+J"
        tabIndex={isStop ? 0 : -1}
        onClick={() => goToRow(store, row)}
      >
        <span
          class={place && places.isSeen(place) ? "dot filled" : "dot"}
          role="img"
          aria-label={at === null ? state : `${number(at)}, ${state}`}
          title={state}
          style={at === null ? {} : { borderColor: finding?.colour }}
        >
          {at !== null && number(at)}
        </span>
        <span class="row-title" title={title}>
          {hasLetter ? titled(t(`letter.${side}`)) : title}
        </span>
        <span class="row-depth">{depth}</span>
        <span class={finding?.is_unconfirmed ? "doubtful row-about" : "row-about"} dir="auto">
          {about.filter(Boolean).join(" · ")}
        </span>
        {list && place && (
          <span class="score-bar" aria-hidden="true">
            <span style={{ width: `${100 * Math.min(place.score / WIDEST_SCORE[list.map], 1)}%` }} />
          </span>
        )}
      </Button>
      {isOpen && <Details store={store} row={row} name={name.join(" · ")} />}
    </li>
  );
}

/** What a reader has decided about a row. */
const judgementOf = ({ finding }: ListRow): Judgement | null =>
  finding && (finding.is_dismissed ? "dismissed" : "kept");

/** What is known of the open row, and what a reader can do about it. */
function Details({ store, row, name }: OfRow & { readonly name: string }) {
  const { findings } = store;
  const { list, place, finding } = row;
  const judgement = judgementOf(row);
  const facts = [
    place && t("candidates.facts", { score: number(place.score, 1), size: number(place.size_mm, 1) }),
    positionWords(place?.position_in_patient ?? middleOf(finding as Finding)),
    ...standardWords((finding ?? place)?.standard),
    finding?.author && t("findings.by", { reader: finding.author }),
  ];
  return (
    <div class="row-details">
      <div class="row one-line">
        <Writing>
          <Buttons
            label={t("places.decision")}
            values={JUDGEMENTS}
            value={judgement}
            words={(one) => t(one === "kept" ? "places.keep" : "places.dismiss")}
            about={(one) => ({ title: keyOf((command) => command.kind === "judge" && command.judgement === one) })}
            onChoose={(one) => {
              if (!finding) return list && place && findings.judge(place, one, list.map);
              // A dismissal is taken back by its button; what was written goes with the bin alone.
              const isBlank = place && !finding.label && !finding.note && !finding.certainty;
              if (isBlank && one === "dismissed" && judgement === one) findings.remove(finding.id);
              else findings.rule(finding, !place && judgement === "dismissed" ? "kept" : one);
            }}
          />
          {finding && (
            <IconButton
              icon="trash"
              label={t("findings.remove", { name })}
              onClick={() => findings.remove(finding.id)}
            />
          )}
        </Writing>
      </div>
      {finding && <Fields store={store} finding={finding} name={name} />}
      <Quiet>{facts.filter(Boolean).join(" · ")}</Quiet>
      {finding && (
        <Row>
          <Button onClick={() => void link(store, finding)}>{t("findings.link")}</Button>
        </Row>
      )}
      {/* The sharpness of the boundary says nothing about the other maps. */}
      {place && list?.map === "blur" && <WhyBars store={store} place={place} />}
      {place && list?.open.value === place && <Chart store={store} />}
    </div>
  );
}

/** Where a place is in other heads. */
function standardWords({ mni152, talairach, error_mm, ac_pc }: Standard = {}): readonly string[] {
  const along = (name: string, position: Vec3): string => `${name} ${position.map((mm) => number(mm)).join(" ")}`;
  return [
    ...(mni152 && talairach
      ? [`${along("MNI 152", mni152)}, ${along("Talairach", talairach)} (± ${number(error_mm ?? NaN)} mm)`]
      : []),
    ...(ac_pc ? [along(t("findings.acpc"), ac_pc)] : []),
  ];
}

/** Copies the address of a finding, which the server has by then. */
async function link({ shown, findings }: Store, { id }: Finding): Promise<void> {
  const { href } = new URL(findingAddress(shown.id, id), location.href);
  try {
    await findings.sync.flush();
  } catch {
    // It is said that the server lacks it.
    return;
  }
  findings.status.value = await copied(href);
}

/** How sharp the boundary is at a place and around it, once the map is here: bars of one scale. */
function WhyBars({ store, place }: OfStore & { readonly place: Candidate }) {
  const [why, setWhy] = useState<Why | null>(null);
  useEffect(() => {
    const { position_in_patient } = place;
    const opposite = reflected(position_in_patient, store.shown.midsagittal);
    store.caseLayers.voxels("sharpness").then(
      (sharpness) => setWhy(whyAt(sharpness, position_in_patient, opposite)),
      () => {},
    );
  }, [place]);
  if (!why) return null;
  const most = Math.max(...Object.values(why).filter(Number.isFinite), 1e-9);
  return (
    <div class="why-bars">
      <Quiet>{t("why.title")}</Quiet>
      {WHY_PARTS.map((part) => {
        const value = why[part];
        const words = Number.isFinite(value) ? `${number(value, 2)} /mm` : "–";
        return (
          <Bar key={part} label={t(`why.${part}`)} share={Number.isFinite(value) ? value / most : 0} words={words} />
        );
      })}
    </div>
  );
}

/** What is written about a finding, and how it is shown. */
function Fields({ store, finding, name }: OfFinding) {
  const { findings } = store;
  const { id, label, note, certainty, colour, is_unconfirmed } = finding;
  return (
    <>
      <Writing>
        {is_unconfirmed && (
          <Row>
            <span class="doubtful">{t("findings.unconfirmed")}</span>
            <Button aria-label={`${name}: ${t("findings.confirm")}`} onClick={() => findings.confirm(id)}>
              {t("findings.confirm")}
            </Button>
          </Row>
        )}
        <Typed
          class="finding-label"
          maxLength={LONGEST_LABEL}
          dir="auto"
          placeholder={t("findings.label")}
          aria-label={`${name}: ${t("findings.label")}`}
          value={label}
          same={(typed) => plainLine(typed, LONGEST_LABEL) === label}
          onType={(typed) => findings.write(id, { label: plainLine(typed, LONGEST_LABEL) })}
          onLeave={(typed) => {
            findings.leaveField();
            return plainLine(typed, LONGEST_LABEL);
          }}
        />
        <Line label={t("findings.certainty")} isTall>
          <Choice
            id={`certainty-${id}`}
            label={`${name}: ${t("findings.certainty")}`}
            values={["", ...CERTAINTIES]}
            value={certainty ?? ""}
            words={(one) => t(one === "" ? "findings.uncertain" : `certainty.${one}`)}
            onChoose={(one) => findings.rate(id, one === "" ? undefined : one)}
          />
        </Line>
        <Written
          class="finding-note"
          rows={2}
          placeholder={t("findings.note")}
          aria-label={`${name}: ${t("findings.note")}`}
          value={note}
          most={LONGEST_NOTE}
          excessWords={(values) => t("findings.excess", values)}
          onType={(typed) => findings.write(id, { note: typed })}
          onLeave={() => findings.leaveField()}
        />
      </Writing>
      <Line label={t("findings.colour")}>
        <Writing>
          <input
            type="color"
            aria-label={`${name}: ${t("findings.colour")}`}
            value={colour}
            onChange={({ currentTarget }) => findings.change(id, { colour: currentTarget.value })}
          />
        </Writing>
        <Ticked
          words={t("findings.drawn")}
          checked={!findings.hidden.value.has(findings.sync.keyOf(finding))}
          onTick={(isDrawn) => findings.show(finding, isDrawn)}
        />
      </Line>
    </>
  );
}

/** Arrows go from row to row. */
function walk(event: KeyboardEvent & { readonly currentTarget: HTMLElement }): void {
  const steps = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  const buttons = [...event.currentTarget.querySelectorAll<HTMLElement>(".row-button")];
  const at = buttons.findIndex((one) => one === document.activeElement);
  if (steps === undefined || at < 0 || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  event.stopPropagation();
  buttons[clamp(at + steps, 0, buttons.length - 1)]?.focus();
}
