// Results for the PACS: chosen, previewed, sent to a node or saved.

import { useEffect, useRef, useState } from "preact/hooks";

import { ask, post, postForFile, send } from "../base/api.ts";
import { known, moment, spoken, t } from "../base/i18n.ts";
import { wait } from "../base/patience.ts";
import { problemWords, sentence } from "../base/problem-words.ts";
import type { Finding } from "../model/findings.ts";
import { pictureBody } from "../model/series.ts";
import { Closing, End, open } from "./dialogs.tsx";
import { type OnScreen, fileStem } from "./export.ts";
import { Button, LabelledChoice, type OfStore, Quiet, Row, Section } from "./fields.tsx";
import { saveFile } from "./picture-file.ts";
import { Shot, useDrawn } from "./server-picture.tsx";

const KINDS = ["view", "sheet", "envelope", "mask", "findings", "finding-segments", "report"] as const;
type Kind = (typeof KINDS)[number];
const PICTURES: readonly Kind[] = ["view", "sheet"];

const LOOK_AGAIN_MS = 500;
const PIXELS = 512;

/** A result that is being sent, or was. */
interface Sending {
  readonly id: string;
  readonly node: string;
  readonly state: "queued" | "running" | "done" | "failed";
  readonly attempts: number;
  readonly reason?: { readonly detail?: string };
  /** Why it does not count any more. */
  readonly not_valid?: string;
  readonly created_at: string;
}

/** What there is to send: no findings if none is confirmed, and no segments of those that were dismissed. */
function kindsOf(list: readonly Finding[]): readonly Kind[] {
  const confirmed = list.filter((one) => !one.is_unconfirmed);
  const lacks = (kind: Kind): boolean =>
    (kind === "findings" && confirmed.length === 0) ||
    (kind === "finding-segments" && confirmed.every((one) => one.is_dismissed));
  return KINDS.filter((kind) => !lacks(kind));
}

function sendingWords({ node, state, attempts, reason, not_valid = "" }: Sending): string {
  const isTried = state === "queued" && attempts > 0;
  const words = t(isTried ? "sending.again" : `sending.${state}`, {
    node,
    count: attempts,
    reason: sentence(reason?.detail ?? ""),
  });
  const invalid = known(`sent.${not_valid}`);
  return invalid ? `${words} ${t(invalid)}` : words;
}

function bodyOf(kind: Kind, { state, surface }: OnScreen): Readonly<Record<string, unknown>> {
  const render = pictureBody(surface.surface.served(state), [PIXELS, PIXELS]);
  switch (kind) {
    case "view":
      return { what: "view", render };
    case "sheet": {
      // Each cell has a depth and a direction of its own, and shows the whole head.
      const { depth_mm, slab_mm, orientation, view, zoom, pan, ...plain } = render;
      return { what: "sheet", render: { ...plain, width: PIXELS / 2, height: PIXELS / 2 }, sheet: {} };
    }
    case "report":
      return { what: "report", report: { language: spoken() } };
    default:
      return { what: kind };
  }
}

interface ResultsProps extends OfStore {
  onScreen(): OnScreen;
}

/** What was sent of the case, and the button that opens the dialog; nothing without a node to send it to. */
export function ResultsSection({ store, onScreen }: ResultsProps) {
  const { shown, nodes } = store;
  const [sent, setSent] = useState<readonly Sending[]>([]);
  const [trouble, setTrouble] = useState("");
  if (nodes.value.length === 0) return null;
  /** Lists what is being sent or was, the newest first. */
  const list = async (): Promise<void> => {
    try {
      setSent((await ask<{ readonly results: readonly Sending[] }>(`v1/dicom-results?case=${shown.id}`)).results);
      setTrouble("");
    } catch (problem) {
      setTrouble(problemWords(problem));
    }
  };
  const choose = (): void => {
    const dialog = <ResultDialog store={store} onScreen={onScreen} />;
    void open(t("pacs.heading"), "server-picture result", dialog, null).then(list);
  };
  return (
    <Section title="pacs.title" name="pacs" data-task="case" onOpen={() => void list()}>
      <Quiet>{t("pacs.text")}</Quiet>
      <Row>
        <Button onClick={choose}>{t("pacs.open")}</Button>
      </Row>
      <ol class="sent-results" aria-label={t("pacs.sent")}>
        {trouble ? (
          <li class="bad">{trouble}</li>
        ) : (
          sent.map((one) => (
            <li key={one.id} data-state={one.state}>
              {`${moment(one.created_at)}: ${sendingWords(one)}`}
            </li>
          ))
        )}
      </ol>
    </Section>
  );
}

function ResultDialog({ store, onScreen }: ResultsProps) {
  const { shown, findings } = store;
  const nodes = store.nodes.peek();
  const [kind, setKind] = useState<Kind>("view");
  const [node, setNode] = useState(nodes[0] ?? "");
  const [said, say] = useState("");
  const [isBusy, setBusy] = useState(false);
  const isOpen = useRef(true);
  useEffect(() => () => void (isOpen.current = false), []);

  const isPicture = PICTURES.includes(kind);
  const path = `v1/cases/${shown.id}/dicom-results`;
  const body = bodyOf(kind, onScreen());
  const drawn = useDrawn(kind, async () => {
    if (!isPicture) return null;
    return (await send(path, { method: "POST", body: JSON.stringify(body), headers: { accept: "image/png" } })).blob();
  });

  /** Does something with the result; nothing else can be asked for meanwhile. */
  const work = async (step: (body: object) => Promise<void>, mustBeSigned = false): Promise<void> => {
    setBusy(true);
    say(t("pacs.drawing"));
    try {
      // The server makes them of what it has.
      if (!isPicture) await findings.sync.flush();
      const canConclude = kind === "findings" || kind === "report";
      const reading = canConclude ? await store.reading.reported(mustBeSigned) : null;
      await step({ ...body, ...(reading && { reading }) });
    } catch (problem) {
      say(problemWords(problem));
    }
    setBusy(false);
  };
  const save = async (asked: object): Promise<void> => {
    saveFile(await postForFile(path, asked), `${fileStem(shown)}-${kind}.dcm`);
    say(t("pacs.saved"));
  };
  const deliver = async (asked: object): Promise<void> => {
    let result = await post<Sending>(path, { ...asked, node });
    while (isOpen.current && (result.state === "queued" || result.state === "running")) {
      say(sendingWords(result));
      await wait(LOOK_AGAIN_MS);
      result = await ask<Sending>(`v1/dicom-results/${result.id}`);
    }
    say(sendingWords(result));
  };
  return (
    <>
      <LabelledChoice
        id="result-kind"
        label={t("pacs.what")}
        values={kindsOf(findings.list.value)}
        value={kind}
        words={(one) => t(`result.${one}`)}
        onChoose={(one) => {
          setKind(one);
          say("");
        }}
        disabled={isBusy}
      />
      <LabelledChoice
        id="result-node"
        label={t("pacs.node")}
        values={nodes}
        value={node}
        words={(one) => one}
        onChoose={(one) => setNode(one)}
        disabled={isBusy}
      />
      <Shot
        name={kind}
        drawn={drawn}
        alt={t("pacs.preview")}
        words={t(isPicture ? "pacs.drawing" : "pacs.no-picture")}
      />
      <p class="quiet" role="status" id="result-said">
        {said}
      </p>
      <End>
        <Closing value="" words={t("pacs.close")} />
        <Button disabled={isBusy} onClick={() => void work(save)}>
          {t("pacs.save")}
        </Button>
        <button type="button" class="primary" disabled={isBusy} onClick={() => void work(deliver, true)}>
          {t("pacs.send")}
        </button>
      </End>
    </>
  );
}
