// The section of the panel with the findings of a case: what a reader marks, writes down and hands on.

import { useLayoutEffect, useRef, useState } from "preact/hooks";

import { gyrusWords, number, t } from "../base/i18n.ts";
import { positionWords } from "../base/readout.ts";
import { CERTAINTIES, type Finding, LONGEST_LABEL, LONGEST_NOTE, middleOf, numbered } from "../model/findings.ts";
import { mirrorPlane, sideOf } from "../model/midsagittal.ts";
import { excessOf, plainLine, plainText } from "../model/text.ts";
import { goToFinding } from "../store/bring.ts";
import { mayWrite } from "../store/holder.ts";
import { choose, preferences } from "../store/preferences.ts";
import {
  Button,
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
} from "./fields.tsx";
import { FindingFiles } from "./findings-files.tsx";

export function FindingsSection({ store }: OfStore) {
  const { findings } = store;
  const list = findings.list.value;
  const numbers = new Map(numbered(list).map(({ id }, at) => [id, at + 1]));
  return (
    <Section title="panel.findings" data-task="read">
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
            return reader;
          }}
        />
      </Line>
      <div class="row one-line">
        <Writing>
          <Button onClick={() => findings.add()}>{t("findings.add")}</Button>
          <IconButton
            icon="undo"
            label={t("findings.undo-last")}
            disabled={!findings.canUndo.value}
            onClick={() => findings.undo()}
          />
          <IconButton
            icon="redo"
            label={t("findings.redo-last")}
            disabled={!findings.canRedo.value}
            onClick={() => findings.redo()}
          />
        </Writing>
      </div>
      {!mayWrite.value && <Quiet>{t("findings.read-only")}</Quiet>}
      <Status id="findings-status" words={findings.status.value} />
      <Status class="doubtful" words={findings.doubled.value} />
      {list.length === 0 ? (
        <Quiet>{t("findings.none")}</Quiet>
      ) : (
        <Ticked
          id="findings-shown"
          words={t("findings.shown")}
          checked={findings.areDrawn.value}
          onTick={(isTicked) => (findings.areDrawn.value = isTicked)}
        />
      )}
      <ol class="findings">
        {list.map((finding) => (
          <FindingRow
            key={findings.sync.keyOf(finding)}
            store={store}
            finding={finding}
            at={numbers.get(finding.id) ?? null}
          />
        ))}
      </ol>
      <FindingFiles store={store} />
    </Section>
  );
}

/** A finding in the list: its name, what is written about it, and how it is shown. `at` is its number; null: it is dismissed. */
function FindingRow({ store, finding, at }: OfStore & { readonly finding: Finding; readonly at: number | null }) {
  const { findings, shown } = store;
  const { id, kind, label, depth_mm, is_dismissed, is_unconfirmed } = finding;
  const isOpen = findings.open.value === findings.sync.keyOf(finding);
  const row = useRef<HTMLLIElement>(null);
  const reached = findings.reached.value;
  useLayoutEffect(() => {
    if (reached === finding) row.current?.scrollIntoView({ block: "nearest" });
  }, [reached]);
  // A new one is written about at once, in sight.
  useLayoutEffect(() => {
    if (findings.written.value !== id) return;
    findings.written.value = null;
    row.current?.closest("details")?.setAttribute("open", "");
    row.current?.querySelector<HTMLElement>(".finding-label")?.focus();
  }, [findings.written.value, isOpen]);
  const name = t(`findings.${kind === "point" ? "name" : kind}`, {
    number: at === null ? t("findings.dismissed") : number(at),
    side: t(`side.${finding.side ?? sideOf(middleOf(finding), mirrorPlane(shown))}`),
    depth: number(depth_mm, 1),
  });
  return (
    <li ref={row} data-id={id} class={is_dismissed ? "dismissed" : ""} aria-current={isOpen}>
      <Row>
        <Button class="finding-name" aria-keyshortcuts="Shift+U Shift+J" onClick={() => goToFinding(store, finding)}>
          {name}
        </Button>
        {isOpen ? (
          <Writing>
            <IconButton icon="trash" label={t("findings.remove", { name })} onClick={() => findings.remove(id)} />
          </Writing>
        ) : (
          <span class={is_unconfirmed ? "doubtful finding-words" : "quiet finding-words"} dir="auto">
            {[is_unconfirmed && t("findings.unconfirmed"), label].filter(Boolean).join(" · ")}
          </span>
        )}
      </Row>
      {isOpen && <Fields store={store} finding={finding} name={name} />}
    </li>
  );
}

/** What is written about the finding that is unfolded, and how it is shown. */
function Fields({ store, finding, name }: OfStore & { readonly finding: Finding; readonly name: string }) {
  const { findings } = store;
  const { id, label, certainty, colour, is_dismissed, is_unconfirmed } = finding;
  const gyrus = gyrusWords(finding.gyrus);
  const where = [
    gyrus && `${t("gyrus.about")}: ${gyrus}`,
    positionWords(middleOf(finding)),
    finding.author && t("findings.by", { reader: finding.author }),
  ];
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
        <Note store={store} finding={finding} label={`${name}: ${t("findings.note")}`} />
      </Writing>
      <Line label={t("findings.colour")}>
        <Writing>
          <input
            type="color"
            aria-label={`${name}: ${t("findings.colour")}`}
            value={colour}
            onChange={({ currentTarget }) => findings.change(id, { colour: currentTarget.value })}
          />
          <Ticked
            words={t("findings.dismiss")}
            checked={is_dismissed}
            onTick={(isTicked) => findings.change(id, { is_dismissed: isTicked })}
          />
        </Writing>
        <Ticked
          words={t("findings.drawn")}
          checked={!findings.hidden.value.has(findings.sync.keyOf(finding))}
          onTick={(isDrawn) => findings.show(finding, isDrawn)}
        />
      </Line>
      <Quiet>{where.filter(Boolean).join(" · ")}</Quiet>
    </>
  );
}

/** What is written about a finding. What is too long stays as it is typed, to be shortened by hand. */
function Note({
  store: { findings },
  finding,
  label,
}: OfStore & { readonly finding: Finding; readonly label: string }) {
  const { id, note } = finding;
  const field = useRef<HTMLTextAreaElement>(null);
  const [excess, setExcess] = useState(0);
  const plain = (typed: string): string => plainText(typed, LONGEST_NOTE);
  useLayoutEffect(() => {
    const area = field.current;
    // What is being typed says the same, but for a space at its end.
    if (!area || plain(area.value) === note) return;
    area.value = note;
    setExcess(0);
  }, [note]);
  return (
    <>
      <textarea
        ref={field}
        class="finding-note"
        rows={2}
        dir="auto"
        placeholder={t("findings.note")}
        aria-label={label}
        onInput={({ currentTarget }) => {
          setExcess(excessOf(currentTarget.value, LONGEST_NOTE));
          findings.write(id, { note: plain(currentTarget.value) });
        }}
        onChange={({ currentTarget }) => {
          if (excess === 0) currentTarget.value = plain(currentTarget.value);
          findings.leaveField();
        }}
      />
      <Status
        class="doubtful"
        words={excess > 0 ? t("findings.excess", { most: number(LONGEST_NOTE), excess: number(excess) }) : ""}
      />
    </>
  );
}
