// The dialog that takes over the findings of another case: the reader sees both heads before agreeing.

import { useEffect, useRef, useState } from "preact/hooks";

import { allCases, ask } from "../base/api.ts";
import { caseIdentity } from "../base/case-words.ts";
import { moment, number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { ReadyCase } from "../model/case.ts";
import type { Finding } from "../model/findings.ts";
import type { ViewState } from "../model/state.ts";
import { patientWords } from "../base/pacs.ts";
import type { Store } from "../store/store.ts";
import { Closing, End, open } from "./dialogs.tsx";
import { LabelledChoice, Status } from "./fields.tsx";
import { ServerPicture } from "./server-picture.tsx";

const PIXELS = 384;

/** Lets the reader choose another case and compare both heads, then takes over its findings. */
export async function takeOver(store: Store): Promise<void> {
  const { findings } = store;
  let other = "";
  const heads = <Heads store={store} onChoose={(id) => (other = id)} />;
  const answer = await open(t("take-over.title"), "take-over", <div class="heads">{heads}</div>, null);
  if (answer !== "take" || other === "") return;
  const before = findings.list.peek();
  const known = new Set(before.map(({ id }) => id));
  try {
    await findings.sync.takeOver(other);
  } catch (problem) {
    return void (findings.status.value = problemWords(problem));
  }
  const taken = findings.list.peek().filter(({ id, is_unconfirmed }) => is_unconfirmed && !known.has(id));
  findings.did(before, [...before, ...taken]);
  findings.status.value = t("take-over.done", { count: number(taken.length) });
}

/** How many findings of a case another one has not. */
async function countNew(id: string, own: readonly Finding[]): Promise<number> {
  const path = `v1/cases/${id}/findings`;
  const { findings } = await ask<{ readonly findings: readonly Finding[] }>(path, { cache: "no-cache" });
  const known = new Set(own.map((one) => one.id));
  return findings.filter((one) => !known.has(one.id)).length;
}

/** Both cases, and the button that agrees once both are seen. */
function Heads({ store, onChoose }: { readonly store: Store; onChoose(id: string): void }) {
  const { shown, findings, view } = store;
  const [cases, setCases] = useState<readonly ReadyCase[]>([]);
  const [other, setOther] = useState<ReadyCase | null>(null);
  /** Of the chosen case; null: not known yet. */
  const [count, setCount] = useState<number | null>(null);
  const [said, say] = useState("");
  const [seen, setSeen] = useState<ReadonlySet<string>>(new Set());
  const asked = useRef("");
  const complain = (problem: unknown): void => say(problemWords(problem));

  const choose = (one: ReadyCase | null): void => {
    asked.current = one?.id ?? "";
    onChoose(asked.current);
    setOther(one);
    setCount(null);
    say("");
    if (!one) return;
    const tell = (found: number): void => {
      if (asked.current !== one.id) return;
      setCount(found);
      say(t("take-over.count", { count: number(found) }));
    };
    countNew(one.id, findings.list.peek()).then(tell, complain);
  };
  useEffect(() => {
    const offer = (all: readonly ReadyCase[]): void => {
      setCases(all);
      // The case before, of which a corrected one is made, comes first to mind.
      choose(all.find(({ id }) => id === shown.previous) ?? null);
    };
    const isOffered = (one: { readonly id: string; readonly state: string }): one is ReadyCase =>
      one.state === "ready" && one.id !== shown.id;
    allCases().then((all) => offer(all.filter(isOffered)), complain);
  }, []);

  const known = (id: string): ReadyCase | null => cases.find((one) => one.id === id) ?? null;
  const see = (id: string): void => setSeen((before) => new Set([...before, id]));
  const isSeen = other !== null && seen.has(other.id) && seen.has(shown.id);
  return (
    <>
      <p class="quiet">{t("take-over.text")}</p>
      <LabelledChoice
        id="take-over-other"
        label={t("take-over.other")}
        values={["", ...cases.map(({ id }) => id)]}
        value={other?.id ?? ""}
        words={(wanted) => (wanted ? caseIdentity(known(wanted) as ReadyCase) : t("compare.choose"))}
        onChoose={(wanted) => choose(known(wanted))}
      />
      <div class="two-heads">
        <Head key={shown.id} title={t("take-over.this")} one={shown} state={view.now} onSeen={see} />
        {other && <Head key={other.id} title={t("take-over.from")} one={other} state={view.now} onSeen={see} />}
      </div>
      <Status words={said} />
      <End>
        <Closing value="" words={t("delete.keep")} />
        <Closing value="take" words={t("take-over.do")} class="primary" disabled={!isSeen || !count} />
      </End>
    </>
  );
}

/** Whose head it is, since when it is here, and a picture in the direction and at the depth of the screen. */
function Head({
  title,
  one,
  state,
  onSeen,
}: {
  readonly title: string;
  readonly one: ReadyCase;
  readonly state: ViewState;
  onSeen(id: string): void;
}) {
  const [patient, setPatient] = useState("");
  // No picture is seen before its patient.
  useEffect(() => {
    const say = (words: string): void => setPatient(words || t("take-over.no-patient"));
    patientWords(one).then(say, () => say(t("pacs.patient-unknown")));
  }, []);
  const query = new URLSearchParams({
    depth_mm: Math.min(state.depth_mm, one.max_depth_mm).toFixed(2),
    orientation: state.orientation.map((part) => part.toFixed(6)).join(","),
    width: String(PIXELS),
    height: String(PIXELS),
    annotate: "true",
  });
  return (
    <section data-id={one.id}>
      <h3>{title}</h3>
      <p>{caseIdentity(one)}</p>
      <p class="patient">{patient}</p>
      <p class="quiet">{`${t("case.uploaded")}: ${moment(one.created_at)}`}</p>
      {one.closed && <p class="bad">{t(`closed.${one.closed}`)}</p>}
      {patient && (
        <ServerPicture
          path={`${one.id}/render?${query}`}
          alt={t("take-over.picture", { name: caseIdentity(one) })}
          onSeen={() => onSeen(one.id)}
        />
      )}
    </section>
  );
}
