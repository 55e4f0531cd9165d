// The list of cases, of any length: only the rows in sight are there.

import { clamp } from "../model/space.ts";
import { useEffect, useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";

import { getPicture } from "../base/api.ts";
import {
  caseFacts,
  caseIdentity,
  caseStatus,
  caseTitle,
  shortTitle,
  titleParts,
  toldApart,
  versionOf,
} from "../base/case-words.ts";
import { t } from "../base/i18n.ts";
import { wait } from "../base/patience.ts";
import { NAMED_VIEWS } from "../model/camera.ts";
import type { Case } from "../model/case.ts";
import { doubtsOf } from "../model/quality.ts";
import { renderQuery } from "../model/query.ts";
import { ROW_PIXELS, isCovered, rowsInSight, scrolledTo } from "../model/rows.ts";
import { firstState } from "../model/state.ts";
import { type Cases, ORDERS } from "../store/cases.ts";
import { mayWrite } from "../store/holder.ts";
import { Choice, IconButton, Placed, Search, Status } from "./fields.tsx";
import { useDrawn } from "./server-picture.tsx";

/** A row that stays in sight for so long gets its picture. */
const LOOK_MS = 120;
const THUMB_PIXELS = 96;

interface ListProps {
  readonly cases: Cases;
  remove(one: Case): void;
}

export function CaseList({ cases, remove }: ListProps) {
  const scroller = useRef<HTMLDivElement>(null);
  const list = useRef<HTMLUListElement>(null);
  const [[scrolled, height], setPlace] = useState([0, 0]);
  /** The row that has the focus, which stays when it is scrolled away. */
  const [focused, setFocused] = useState<string | null>(null);
  const wantsFocus = useRef(false);
  const wanted = cases.wanted.value;
  const open = wanted.findIndex(({ id }) => id === cases.open.value);
  const flagged = [...cases.flags.value.keys()].at(-1);
  const flaggedAt = wanted.findIndex(({ id }) => id === flagged);

  const stir = (): void => {
    const { scrollTop = 0, clientHeight = 0 } = scroller.current ?? {};
    setPlace([scrollTop, clientHeight]);
  };
  useLayoutEffect(() => {
    const resized = new ResizeObserver(stir);
    if (scroller.current) resized.observe(scroller.current);
    return () => resized.disconnect();
  }, []);
  /** Scrolls until a row is in sight. */
  const reach = (at: number): void => {
    if (scroller.current && at >= 0)
      scroller.current.scrollTop = scrolledTo(at, open, scroller.current.scrollTop, scroller.current.clientHeight);
  };
  useEffect(() => reach(flaggedAt), [flagged, flaggedAt < 0]);
  useLayoutEffect(() => {
    if (!wantsFocus.current) return;
    wantsFocus.current = false;
    list.current?.querySelector<HTMLElement>(`[data-id="${focused}"] a`)?.focus({ preventScroll: true });
  });
  // Another order and another search begin at the top, once their rows are there.
  useLayoutEffect(() => {
    if (scroller.current) scroller.current.scrollTop = 0;
    stir();
  }, [cases.order.value, cases.search.value]);
  /** Arrows go from case to case. */
  const walk = (event: KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const last = wanted.length - 1;
    const at = wanted.findIndex(({ id }) => id === focused);
    const page = Math.max(Math.floor(height / ROW_PIXELS) - 1, 1);
    const to = { ArrowDown: at + 1, ArrowUp: at - 1, PageDown: at + page, PageUp: at - page, Home: 0, End: last }[
      event.key
    ];
    if (to === undefined || at < 0) return;
    event.preventDefault();
    const next = clamp(to, 0, last);
    reach(next);
    wantsFocus.current = true;
    setFocused(wanted[next]?.id ?? null);
  };

  const count = wanted.length;
  const [first, end] = rowsInSight(count, scrolled, height);
  const kept = wanted.flatMap(({ id }, at) => (at === open || id === focused ? [at] : []));
  const above = kept.filter((at) => at < first);
  const below = kept.filter((at) => at >= end);
  const rows = [...above, ...Array.from({ length: end - first }, (_, at) => first + at), ...below];
  const paddingTop = `${(first - above.length) * ROW_PIXELS}px`;
  const paddingBottom = `${(count - end - below.length) * ROW_PIXELS}px`;
  return (
    <div class="case-list-box">
      <div class="line">
        <Search id="case-search" label={t("cases.search")} onSearch={(typed) => (cases.search.value = typed)} />
        <Choice
          id="case-order"
          label={t("order.title")}
          values={ORDERS}
          value={cases.order.value}
          words={(order) => t(`order.${order}`)}
          onChoose={(order) => (cases.order.value = order)}
        />
      </div>
      <Status id="cases-note" words={cases.note.value} />
      <div class="case-scroller" ref={scroller} onScroll={stir}>
        <ul
          id="case-list"
          ref={list}
          style={{ paddingTop, paddingBottom }}
          onKeyDown={walk}
          onFocusIn={({ target }) => setFocused((target as Element).closest("li")?.dataset.id ?? null)}
          onFocusOut={() => setFocused(null)}
        >
          {rows.map((at) => {
            const one = wanted[at] as Case;
            return (
              <Row
                key={one.id}
                one={one}
                alike={cases.alike.value.get(shortTitle(one)) ?? []}
                place={[at + 1, count]}
                isOpen={at === open}
                isHidden={one.id !== focused && isCovered(at, open, scrolled, height)}
                flag={cases.flags.value.get(one.id) ?? ""}
                choose={() => (cases.chosen = one.id)}
                remove={() => remove(one)}
              />
            );
          })}
        </ul>
      </div>
    </div>
  );
}

interface RowProps {
  readonly one: Case;
  readonly alike: readonly Case[];
  readonly place: readonly [number, number];
  readonly isOpen: boolean;
  /** Whether it is taken out of reach, because the open one covers it. */
  readonly isHidden: boolean;
  /** Why it is pointed out; empty: it is not. */
  readonly flag: string;
  choose(): void;
  remove(): void;
}

function Row({ one, alike, place, isOpen, isHidden, flag, choose, remove }: RowProps) {
  const version = versionOf(one);
  const apart = toldApart(one, alike);
  const isReady = one.state === "ready";
  const quality = isReady ? one.quality : undefined;
  const doubts = doubtsOf(quality);
  const [begins, ends] = titleParts(caseTitle(one));
  return (
    <li
      data-id={one.id}
      data-state={one.state}
      title={caseFacts(one)}
      aria-posinset={place[0]}
      aria-setsize={place[1]}
      style={{ visibility: isHidden ? "hidden" : "" }}
    >
      <a
        href={`#${one.id}`}
        aria-keyshortcuts="Delete"
        aria-current={isOpen ? "true" : undefined}
        onClick={(event) => {
          choose();
          // The case that is open stays as it is.
          if (isOpen) event.preventDefault();
        }}
        onKeyDown={({ key }) => key === "Delete" && mayWrite.peek() && remove()}
      >
        <Thumb one={one} />
        <span class="words">
          <span class="head">
            {/* A long title is cut in its middle. */}
            <span class="title">
              {ends === "" ? begins : [<span class="begins">{begins}</span>, <span class="ends">{ends}</span>]}
            </span>
            {quality && doubts[0] && (
              <span
                class="quality-badge"
                data-verdict={quality.state}
                title={doubts.map((doubt) => t(`quality.${doubt}`)).join("\n")}
              >
                <span class="visually-hidden">{t(`quality.${doubts[0]}`)}</span>
              </span>
            )}
          </span>
          <span class="facts">
            {flag && <span class="fresh-badge">{flag}</span>}
            {one.closed && <span class="closed-badge">{t(`closed.${one.closed}`)}</span>}
            {/* What tells it apart has the room of its id, which names a case without a label above. */}
            {one.name && (apart === "" || version !== "") && <span class="id">{one.id.slice(0, 8)}</span>}
            {/* There is room for one of them. */}
            {(version === "" || !isReady) && <span class="status">{apart || caseStatus(one)}</span>}
            {version && <span class="status">{version}</span>}
          </span>
          {one.state === "preparing" && (
            <progress max={1} value={one.progress?.fraction ?? 0} aria-label={t("case.progress")} />
          )}
        </span>
      </a>
      {/* A row is one stop of the tabulator: its key is Delete. */}
      {mayWrite.value && (
        <IconButton
          icon="trash"
          label={t("delete.button", { title: caseIdentity(one) })}
          tabIndex={-1}
          onClick={remove}
        />
      )}
    </li>
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
