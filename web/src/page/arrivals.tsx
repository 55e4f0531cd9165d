// The series that came from a PACS: listed, filtered, and one that was refused taken as a case or as a layer.

import { useEffect, useRef, useState } from "preact/hooks";

import { ask, post } from "../base/api.ts";
import { type Key, known, moment, t } from "../base/i18n.ts";
import { wait } from "../base/patience.ts";
import { problemWords, sentence } from "../base/problem-words.ts";
import { Closing, End, open } from "./dialogs.tsx";
import { Button, Choice, Quiet, Search, Status } from "./fields.tsx";
import { Rejections } from "./rejections.tsx";

const STATES = ["receiving", "case", "layer", "nothing"] as const;
type State = (typeof STATES)[number];

/** Why a series became nothing. */
interface Reason {
  readonly name: string;
  readonly detail: string;
}

/** A series that came, as the server lists it. */
export interface Arrival {
  readonly id: string;
  readonly state: State;
  readonly first_at: string;
  readonly instances: number;
  /** Images that took the place of others. */
  readonly corrected: number;
  /** Objects that were not kept. */
  readonly ignored: number;
  /** Objects that were refused, and why the last of them was. */
  readonly refused_objects: number;
  readonly last_refusal?: string;
  readonly expected?: number;
  readonly label?: string;
  readonly case?: string;
  readonly reason?: Reason;
  /** Why it was refused before somebody took it. */
  readonly refused?: Reason;
}

interface Page {
  readonly arrivals: readonly Arrival[];
  readonly next?: string;
}

type Taken = "case" | "layer";

const LOOK_AGAIN_MS = 1000;
/** So long after the last letter the list is asked for. */
const TYPED_MS = 300;
/** The reason that somebody may overlook: the slices are interpolated. */
const GAPS = "dicom-slices-missing";

/** What a series can be taken as: what was refused as either, a layer as a case. */
export function takeable({ state, instances }: Pick<Arrival, "state" | "instances">): readonly Taken[] {
  if (state === "layer") return ["case"];
  return state === "nothing" && instances > 0 ? ["case", "layer"] : [];
}

const reasonWords = ({ name, detail }: Reason): string => {
  const key = known(`problem.${name}`);
  return key ? t(key) : t("problem.english", { detail: sentence(detail) });
};

/** What came, and what of it is not kept. */
export function arrivalFacts(arrival: Arrival): readonly string[] {
  const { first_at, instances, expected, corrected, ignored, refused_objects, last_refusal } = arrival;
  const images = expected && expected !== instances ? "arrival.images-of" : "arrival.images";
  return [
    moment(first_at),
    t(images, { count: instances, expected }),
    ...(corrected > 0 ? [t("arrival.corrected", { count: corrected })] : []),
    ...(ignored > 0 ? [t("arrival.ignored", { count: ignored })] : []),
    ...(refused_objects > 0 ? [t("arrival.refused-objects", { count: refused_objects, reason: last_refusal })] : []),
  ];
}

const labelOf = ({ label }: Arrival): string => label ?? t("arrival.unlabelled");

/** Shows what came; a link to a case closes the list, and `chosen` hears which. */
export function arrivalsDialog(chosen: (id: string) => void): void {
  void open(t("arrivals.title"), "of-pacs", <Arrivals chosen={chosen} />, null);
}

function Arrivals({ chosen }: { chosen(id: string): void }) {
  const [state, setState] = useState<State | "">("");
  const [text, setText] = useState("");
  const [list, setList] = useState<readonly Arrival[]>([]);
  const [next, setNext] = useState<string | null>(null);
  const [note, say] = useState("");
  /** Of several answers the one to the latest question counts. */
  const turn = useRef(0);
  const asked = useRef("");

  /** Lists those that the filter fits, from the newest or behind those that are listed. */
  const look = async (after: string | null): Promise<void> => {
    const mine = (turn.current += 1);
    const query = new URLSearchParams({ ...(state && { state }), ...(text && { text }), ...(after && { after }) });
    try {
      const page = await ask<Page>(`v1/arrivals?${query}`);
      if (mine !== turn.current) return;
      const all = after ? [...list, ...page.arrivals] : page.arrivals;
      setList(all);
      setNext(page.next ?? null);
      say(all.length === 0 ? t("arrivals.none") : "");
    } catch (problem) {
      if (mine === turn.current) say(problemWords(problem));
    }
  };
  useEffect(() => {
    const timer = setTimeout(() => void look(null), text === asked.current ? 0 : TYPED_MS);
    asked.current = text;
    return () => clearTimeout(timer);
  }, [state, text]);
  useEffect(() => () => void (turn.current = NaN), []);
  const put = (now: Arrival): void => {
    setList((before) => before.map((one) => (one.id === now.id ? now : one)));
    say(`${labelOf(now)}: ${t(`arrival.${now.state}`)}`);
  };
  return (
    <>
      <div class="line">
        <Search id="arrival-text" label={t("arrivals.search")} onSearch={setText} />
        <Choice
          id="arrival-state"
          label={t("arrivals.state")}
          values={["", ...STATES]}
          value={state}
          words={(one) => t(one ? `arrival.${one}` : "arrivals.all")}
          onChoose={(one) => setState(one)}
        />
      </div>
      <Status words={note} />
      <ul class="arrivals">
        {list.map((one) => (
          <Item key={one.id} one={one} chosen={chosen} put={put} />
        ))}
      </ul>
      <div>
        <Rejections lifted={() => void look(null)} />
      </div>
      <End>
        {next !== null && <Button onClick={() => void look(next)}>{t("arrivals.more")}</Button>}
        <Closing class="primary" />
      </End>
    </>
  );
}

interface ItemProps {
  readonly one: Arrival;
  chosen(id: string): void;
  put(now: Arrival): void;
}

function Item({ one, chosen, put }: ItemProps) {
  const { state, reason, refused } = one;
  const [said, say] = useState("");
  const [isTaking, setTaking] = useState(false);
  const item = useRef<HTMLLIElement>(null);

  const wasTaken = useRef(false);

  // The focus was on a button that is gone.
  useEffect(() => {
    const isLost = wasTaken.current && document.activeElement === document.body;
    if (isLost) item.current?.querySelector<HTMLElement>("a, button")?.focus();
  }, [state]);
  const show = (id: string): void => {
    chosen(id);
    item.current?.closest("dialog")?.close();
  };
  /** Takes the series, and says what becomes of it. */
  const take = async (as: Taken, allow_gaps: boolean): Promise<void> => {
    setTaking(true);
    wasTaken.current = true;
    say(t("arrival.taking"));
    try {
      let now = await post<Arrival>(`v1/arrivals/${one.id}`, { as, allow_gaps });
      while (now.state === "receiving" && item.current) {
        await wait(LOOK_AGAIN_MS);
        now = await ask<Arrival>(`v1/arrivals/${one.id}`);
      }
      put(now);
      say("");
    } catch (problem) {
      say(problemWords(problem));
    }
    setTaking(false);
  };
  return (
    <li data-id={one.id} data-state={state} ref={item}>
      <p class="layer-name">
        <strong>{labelOf(one)}</strong>
        <span class="state">{t(`arrival.${state}`)}</span>
      </p>
      <Quiet>{arrivalFacts(one).join(" · ")}</Quiet>
      {state === "nothing" && reason && <p class="why">{reasonWords(reason)}</p>}
      {state !== "nothing" && refused && <Quiet>{t("arrival.refused", { reason: reasonWords(refused) })}</Quiet>}
      <div class="row">
        {one.case && (
          <a href={`#${one.case}`} onClick={() => show(one.case ?? "")}>
            {t("arrival.open")}
          </a>
        )}
        {takeable(one).map((as) => {
          const hasGaps = as === "case" && reason?.name === GAPS;
          const words: Key = hasGaps ? "arrival.take-gaps" : `arrival.take-${as}`;
          return (
            <Button key={as} disabled={isTaking} onClick={() => void take(as, hasGaps)}>
              {t(words)}
            </Button>
          );
        })}
      </div>
      <Status words={said} />
    </li>
  );
}
