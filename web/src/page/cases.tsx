// The list of cases, of any length: only the rows in sight are there. Where it has room it is a table, beside a picture it has two lines a row.

import { clamp } from "../model/space.ts";
import { useEffect, useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";

import { getPicture } from "../base/api.ts";
import {
  caseFacts,
  caseIdentity,
  caseStatus,
  caseTitle,
  seriesWords,
  titleParts,
  versionOf,
} from "../base/case-words.ts";
import { day, number, t } from "../base/i18n.ts";
import { wait } from "../base/patience.ts";
import { NAMED_VIEWS } from "../model/camera.ts";
import type { Case, Listed } from "../model/case.ts";
import { doubtsOf } from "../model/quality.ts";
import { renderQuery } from "../model/query.ts";
import { ROW_PIXELS, rowsInSight, scrolledTo } from "../model/rows.ts";
import { firstState } from "../model/state.ts";
import { DAYS, HAVINGS, MASKS, ORDERS, type Order, STATUSES } from "../model/worklist.ts";
import { mayWrite } from "../store/holder.ts";
import type { App } from "./app.ts";
import { Button, Choice, IconButton, Placed, Search, Status } from "./fields.tsx";
import { useDrawn } from "./server-picture.tsx";

/** A row that stays in sight for so long gets its picture. */
const LOOK_MS = 120;
const THUMB_PIXELS = 96;

type Column = "label" | "series" | "day" | "mask" | "layers" | "places" | "findings" | "reader" | "state";

/** The columns, with the order that each can be listed in. */
const COLUMNS: readonly (readonly [name: Column, order?: Order])[] = [
  ["label", "label"],
  ["series"],
  ["day", "newest"],
  ["mask"],
  ["layers"],
  ["places", "places"],
  ["findings", "findings"],
  ["reader"],
  ["state"],
];

export function CaseList({ app }: { readonly app: App }) {
  const { cases } = app;
  const scroller = useRef<HTMLDivElement>(null);
  const list = useRef<HTMLDivElement>(null);
  const [[scrolled, height], setPlace] = useState([0, 0]);
  /** The row that has the focus, which stays when it is scrolled away. */
  const [focused, setFocused] = useState(-1);
  /** The row that is to have it, once it is there. */
  const goal = useRef(-1);
  const filter = cases.filter.value;
  const count = cases.total.value;
  void cases.here.value;
  const flagged = [...cases.flags.value.keys()].at(-1) ?? null;
  const flaggedAt = cases.rowOf(flagged);
  const openAt = cases.rowOf(cases.open.value);
  const [first, end] = rowsInSight(count, scrolled, height);

  const stir = (): void => {
    const box = scroller.current;
    // While it is hidden it stays where it was.
    if (box && box.clientHeight > 0) setPlace([box.scrollTop, box.clientHeight]);
  };
  /** Scrolls until a row is in sight. */
  const reach = (row: number): void => {
    const box = scroller.current;
    if (box && row >= 0) box.scrollTop = scrolledTo(row, box.scrollTop, box.clientHeight);
  };
  useLayoutEffect(() => {
    const box = scroller.current;
    if (!box) return;
    let place = 0;
    box.addEventListener("scroll", () => (place = box.clientHeight > 0 ? box.scrollTop : place));
    const resized = new ResizeObserver(() => {
      if (box.scrollTop === 0) box.scrollTop = place;
      stir();
    });
    resized.observe(box);
    return () => resized.disconnect();
  }, []);
  useEffect(() => cases.see(first, end), [first, end, count]);
  useEffect(() => reach(flaggedAt), [flagged, flaggedAt < 0]);
  useEffect(() => reach(openAt), [cases.open.value, openAt < 0, app.isStart.value]);
  useLayoutEffect(() => {
    const link = list.current?.querySelector<HTMLElement>(`[aria-rowindex="${goal.current + 2}"] a`);
    if (goal.current < 0 || !link) return;
    goal.current = -1;
    link.focus({ preventScroll: true });
  });
  // Another filter and another order begin at the top.
  useLayoutEffect(() => {
    if (scroller.current) scroller.current.scrollTop = 0;
    stir();
  }, [filter]);
  /** Arrows go from case to case. */
  const walk = (event: KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const at = goal.current < 0 ? focused : goal.current;
    const page = Math.max(Math.floor(height / ROW_PIXELS) - 1, 1);
    const to = { ArrowDown: at + 1, ArrowUp: at - 1, PageDown: at + page, PageUp: at - page, Home: 0, End: count - 1 }[
      event.key
    ];
    if (to === undefined || at < 0) return;
    event.preventDefault();
    goal.current = clamp(to, 0, count - 1);
    reach(goal.current);
    stir();
  };

  const isKept = focused >= 0 && focused < count && (focused < first || focused >= end);
  const isAbove = isKept && focused < first;
  const rows = Array.from({ length: end - first }, (_, at) => first + at);
  if (isKept) rows[isAbove ? "unshift" : "push"](focused);
  const paddingTop = `${(first - Number(isAbove)) * ROW_PIXELS}px`;
  const paddingBottom = `${(count - end - Number(isKept && !isAbove)) * ROW_PIXELS}px`;
  return (
    <div class="case-list-box">
      <div class="filters">
        <Search id="case-search" label={t("cases.search")} onSearch={(text) => cases.choose({ text })} />
        <Choice
          id="case-status"
          label={t("cases.status")}
          values={["", ...STATUSES]}
          value={filter.status}
          words={(status) => t(`status.${status || "all"}`)}
          onChoose={(status) => cases.choose({ status })}
        />
        <Choice
          id="case-days"
          label={t("cases.days")}
          values={["", ...DAYS]}
          value={filter.days}
          words={(days) => t(`days.${days || "all"}`)}
          onChoose={(days) => cases.choose({ days })}
        />
        <Choice
          id="case-mask"
          label={t("cases.mask")}
          values={["", ...MASKS]}
          value={filter.mask}
          words={(mask) => t(`mask.${mask || "all"}`)}
          onChoose={(mask) => cases.choose({ mask })}
        />
        <Choice
          id="case-has"
          label={t("cases.has")}
          values={["", ...HAVINGS]}
          value={filter.has}
          words={(has) => t(`has.${has || "all"}`)}
          onChoose={(has) => cases.choose({ has })}
        />
        <Choice
          id="case-order"
          label={t("order.title")}
          values={ORDERS}
          value={filter.sort}
          words={(order) => t(`order.${order}`)}
          onChoose={(sort) => cases.choose({ sort })}
        />
        <span class="quiet" id="case-count">
          {count > 0 && t(count === 1 ? "cases.one" : "cases.count", { count: number(count) })}
        </span>
      </div>
      <Status id="cases-note" words={cases.note.value} />
      <Trashed app={app} />
      <div class="case-table" role="table" aria-label={t("cases.title")} aria-rowcount={count + 1} hidden={count === 0}>
        <div class="case-heads" role="rowgroup">
          <div class="case" role="row" aria-rowindex={1}>
            {COLUMNS.map(([name, order]) => (
              <span key={name} role="columnheader" class={`c-${name}`} aria-sort={sortOf(filter.sort, order)}>
                {order ? (
                  <Button
                    onClick={() =>
                      cases.choose({ sort: order === filter.sort && order === "newest" ? "oldest" : order })
                    }
                  >
                    {t(`column.${name}`)}
                  </Button>
                ) : (
                  t(`column.${name}`)
                )}
              </span>
            ))}
          </div>
        </div>
        <div class="case-scroller" ref={scroller} onScroll={stir}>
          <div
            id="case-list"
            role="rowgroup"
            ref={list}
            style={{ paddingTop, paddingBottom }}
            onKeyDown={walk}
            onFocusIn={({ target }) => {
              const row = (target as Element).closest("[aria-rowindex]");
              setFocused(Number(row?.getAttribute("aria-rowindex")) - 2);
            }}
            onFocusOut={() => goal.current < 0 && setFocused(-1)}
          >
            {rows.map((row) => {
              const one = cases.at(row);
              return <Row key={one?.id ?? row} app={app} one={one} row={row} />;
            })}
          </div>
        </div>
      </div>
    </div>
  );
}

/** How a column is sorted, if the list is sorted by it. */
function sortOf(sort: Order, order: Order | undefined): "ascending" | "descending" | undefined {
  if (order === "newest" && sort === "oldest") return "ascending";
  if (order !== sort) return undefined;
  return order === "label" ? "ascending" : "descending";
}

/** What was put into the trash last is a click away. */
function Trashed({ app }: { readonly app: App }) {
  const one = app.trashed.value;
  return one ? (
    <p class="trashed">
      {t("trash.done", { title: caseTitle(one) })}{" "}
      <Button onClick={() => void app.trash(one, false)}>{t("undo")}</Button>
    </p>
  ) : null;
}

interface RowProps {
  readonly app: App;
  /** Null while it is on its way. */
  readonly one: Listed | null;
  readonly row: number;
}

function Row({ app, one, row }: RowProps) {
  if (!one) return <div class="case" role="row" aria-rowindex={row + 2} aria-busy="true" />;
  const { cases } = app;
  const isOpen = one.id === cases.open.value;
  const flag = cases.flags.value.get(one.id);
  const [begins, ends] = titleParts(caseTitle(one));
  const status = one.state === "ready" ? t(`status.${one.status}`) : caseStatus(one);
  const words: Readonly<Partial<Record<Column, string>>> = {
    series: one.state === "ready" ? seriesWords(one) : "",
    day: day(one.created_at),
    layers: one.layers?.join(", ") ?? "",
    places: one.places === undefined ? "" : number(one.places),
    findings: one.finding_count > 0 ? number(one.finding_count) : "",
    reader: one.readers?.join(", ") ?? "",
  };
  const away = (): void => void (one.trashed ? app.remove(one) : app.trash(one, true));
  return (
    <div
      class="case"
      role="row"
      aria-rowindex={row + 2}
      aria-current={isOpen ? "true" : undefined}
      data-id={one.id}
      data-state={one.state}
      title={caseFacts(one)}
    >
      {COLUMNS.map(([name]) => (
        <span key={name} role="cell" class={`c-${name}`}>
          {name === "label" ? (
            <>
              <Thumb one={one} />
              <a
                href={`#${one.id}`}
                aria-keyshortcuts={mayWrite.value ? "Delete" : undefined}
                onClick={(event) => {
                  cases.chosen = one.id;
                  // The case that is open stays as it is.
                  if (isOpen) event.preventDefault();
                }}
                onKeyDown={({ key }) => key === "Delete" && mayWrite.peek() && away()}
              >
                {/* A long title is cut in its middle. */}
                <span class="title">
                  {ends === "" ? begins : [<span class="begins">{begins}</span>, <span class="ends">{ends}</span>]}
                </span>
              </a>
              <span class="facts">
                {flag && <span class="fresh-badge">{flag}</span>}
                {one.closed && <span class="closed-badge">{t(`closed.${one.closed}`)}</span>}
                <span class="short-day">{words.day}</span>
                {/* It names a case without a label above. */}
                <span class="id">{versionOf(one) || (one.name && one.id.slice(0, 8))}</span>
              </span>
            </>
          ) : name === "mask" ? (
            <Mask one={one} />
          ) : name === "state" ? (
            <>
              <span class="status">{status}</span>
              {one.state === "preparing" && (
                <progress max={1} value={one.progress?.fraction ?? 0} aria-label={t("case.progress")} />
              )}
              {/* A row is one stop of the tabulator: its key is Delete. */}
              {mayWrite.value && one.trashed && (
                <IconButton
                  icon="undo"
                  label={t("trash.restore", { title: caseIdentity(one) })}
                  tabIndex={-1}
                  onClick={() => void app.trash(one, false)}
                />
              )}
              {mayWrite.value && (
                <IconButton
                  icon="trash"
                  label={t(one.trashed ? "delete.button" : "trash.button", { title: caseIdentity(one) })}
                  tabIndex={-1}
                  onClick={away}
                />
              )}
            </>
          ) : (
            words[name]
          )}
        </span>
      ))}
    </div>
  );
}

/** How far the mask is to be trusted. */
function Mask({ one }: { readonly one: Case }) {
  const quality = one.state === "ready" ? one.quality : undefined;
  const [doubt] = doubtsOf(quality);
  if (!quality) return null;
  return doubt ? (
    <span class="quality-badge" data-verdict={quality.state}>
      <span>{t(`quality.${doubt}`)}</span>
    </span>
  ) : (
    <span class="quiet">{t("quality.ok")}</span>
  );
}

/** The left side of a case that is ready. The list works without it. */
function Thumb({ one }: { readonly one: Case }) {
  const [isLooked, look] = useState(false);
  useEffect(() => {
    let isThere = true;
    void wait(LOOK_MS).then(() => isThere && look(true));
    return () => void (isThere = false);
  }, []);
  const path = useMemo(() => {
    if (one.state !== "ready") return "";
    const state = { ...firstState(one), orientation: NAMED_VIEWS.left, way: "exact" } as const;
    return `${one.id}/render?${renderQuery(state, [THUMB_PIXELS, THUMB_PIXELS])}`;
  }, [one.id, one.state]);
  const drawn = useDrawn(isLooked ? path : "", async () => (isLooked && path ? getPicture(path) : null));
  return (
    <span class="thumb" aria-hidden="true">
      {drawn instanceof HTMLImageElement && <Placed node={drawn} />}
    </span>
  );
}
