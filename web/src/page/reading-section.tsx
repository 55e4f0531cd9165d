// The conclusion of whoever reads, its signature, and the readings of others beside it.

import { useEffect, useState } from "preact/hooks";

import { ask, plainName } from "../base/api.ts";
import { type Key, gyrusWords, moment, namesOf, number, t } from "../base/i18n.ts";
import { positionWords } from "../base/readout.ts";
import { problemWords } from "../base/problem-words.ts";
import { type Finding, middleOf, numbered } from "../model/findings.ts";
import {
  FIELDS,
  type Field,
  LONGEST_CONCLUSION,
  type ListedReading,
  type Reading,
  SAME_PLACE_MM,
  TEMPLATE,
  compared,
  ofOthers,
} from "../model/readings.ts";
import { isNamed, mayWrite } from "../store/holder.ts";
import { confirmSign, open } from "./dialogs.tsx";
import { Button, ChoiceLine, type OfStore, Quiet, Row, Section, Status, Written } from "./fields.tsx";

/** A reader as people know them. */
const nameOf = ({ reader }: { readonly reader: string }): string => plainName({ name: reader });

/** What may be stated in a field of a template: all that the page has words for, but for what is no choice of a reader's. */
const choicesOf = (field: Field): readonly string[] =>
  namesOf(`${TEMPLATE[field]}.`).filter((name) => !/^(about|middle|unknown)$/.test(name));

const wordOf = (field: Field, word: string): string => t(`${TEMPLATE[field]}.${word}` as Key);

const momentOf = ({ signed_at }: { readonly signed_at?: string }): string => (signed_at ? moment(signed_at) : "–");

export function ReadingSection({ store }: OfStore) {
  const { reading } = store;
  const mayRead = isNamed.value && mayWrite.value;
  useEffect(() => void reading.load(), [mayRead]);
  // Whoever may only look has nothing to conclude here.
  if (!mayWrite.value && ofOthers(reading.all.value).length === 0) return null;
  return (
    <Section title="panel.reading" name="reading" data-task="read" onOpen={() => void reading.load()}>
      {mayRead && <Own store={store} />}
      {mayWrite.value && !isNamed.value && <Quiet>{t("problem.reader-unnamed")}</Quiet>}
      <Others store={store} />
    </Section>
  );
}

/** One's own conclusion, and its signature. */
function Own({ store }: OfStore) {
  const { reading, findings } = store;
  const mine = reading.mine.value;
  const { conclusion, template } = reading.value.value;
  const isSigned = reading.isSigned.value;
  const signed = isSigned ? mine : reading.signed.value;
  const sign = async (): Promise<void> => {
    if (!mine) return;
    const { seen } = reading;
    const count = number(numbered(seen.findings).length);
    const about = { version: number(mine.version), count, reader: nameOf(mine) };
    if (await confirmSign(t("reading.ask-text", about))) await reading.sign(seen);
  };
  return (
    <>
      <fieldset class="writing" disabled={!mine || isSigned || reading.isBusy.value}>
        <Written
          id="conclusion"
          rows={4}
          placeholder={t("reading.conclusion")}
          aria-label={t("reading.conclusion")}
          value={conclusion}
          most={LONGEST_CONCLUSION}
          excessWords={(values) => t("reading.excess", values)}
          onType={(conclusion) => reading.write({ conclusion })}
        />
        <details>
          <summary>{t("template.title")}</summary>
          <div class="group-part">
            {FIELDS.map((field) => (
              <ChoiceLine
                key={field}
                id={`template-${field}`}
                label={t(`template.${field}`)}
                values={["", ...choicesOf(field)]}
                value={template[field] ?? ""}
                words={(word) => (word ? wordOf(field, word) : "–")}
                onChoose={(word) => {
                  const { [field]: _before, ...others } = template;
                  reading.write({ template: { ...others, ...(word && { [field]: word }) } });
                }}
              />
            ))}
          </div>
        </details>
      </fieldset>
      {signed && (
        <p class="signed">
          {t("reading.signed", { version: number(signed.version), reader: nameOf(signed), at: momentOf(signed) })}
        </p>
      )}
      {reading.isAhead.value && <Quiet>{t("reading.unsigned")}</Quiet>}
      <Status id="reading-status" words={reading.status.value} />
      {mine && !isSigned && (
        <Quiet>
          {mine.version > 1 ? t("reading.correcting", { version: number(mine.version) }) : t("reading.hint")}
        </Quiet>
      )}
      <Row>
        {isSigned ? (
          <Button disabled={reading.isBusy.value} onClick={() => void reading.correct()}>
            {t("reading.correct")}
          </Button>
        ) : (
          <Button
            disabled={!mine || !findings.sync.isRead.value || !reading.isBegun.value || reading.isBusy.value}
            onClick={() => void sign()}
          >
            {t("reading.sign")}
          </Button>
        )}
      </Row>
    </>
  );
}

/** Who else has read the case. */
function Others({ store }: OfStore) {
  const others = ofOthers(store.reading.all.value);
  if (others.length === 0) return null;
  return (
    <ul class="other-readings" aria-label={t("reading.others")}>
      {others.map((one) => (
        <li key={one.reader}>
          <span>
            {one.state === "open"
              ? t("reading.other-open", { reader: nameOf(one) })
              : t("reading.other-signed", { reader: nameOf(one), at: momentOf(one) })}
          </span>
          {one.state === "signed" && !one.is_shown && <Quiet>{t("reading.hidden")}</Quiet>}
          {one.is_shown && (
            <Button
              onClick={() => void open(t("reading.compare-title"), "readings", <Both store={store} other={one} />)}
            >
              {t("reading.compare", { reader: nameOf(one) })}
            </Button>
          )}
        </li>
      ))}
    </ul>
  );
}

/** One's own last signed reading and that of somebody else, side by side. */
function Both({ store: { reading, shown }, other }: OfStore & { readonly other: ListedReading }) {
  const [both, setBoth] = useState<readonly [Reading, Reading] | null>(null);
  const [said, say] = useState("");
  useEffect(() => {
    const mine = reading.signed.peek();
    const ofVersion = ({ reader, version }: ListedReading): Promise<Reading> =>
      ask(`v1/cases/${shown.id}/readings/by/${encodeURIComponent(reader)}?version=${version}`);
    const asked = mine ? [mine, other] : [];
    Promise.all(asked.map(ofVersion)).then(
      ([own, theirs]) => own && theirs && setBoth([own, theirs]),
      (problem: unknown) => say(problemWords(problem)),
    );
  }, []);
  if (!both) return <Status words={said} />;
  const [mine, theirs] = both;
  const { both: agreed, ...alone } = compared(mine.findings, theirs.findings);
  const reader = nameOf(theirs);
  const groups = [
    [t("reading.agreed", { mm: number(SAME_PLACE_MM), count: number(agreed.length) }), agreed],
    [t("reading.mine-alone", { count: number(alone.mine.length) }), alone.mine.map((one) => [one, null] as const)],
    [
      t("reading.theirs-alone", { reader, count: number(alone.theirs.length) }),
      alone.theirs.map((one) => [null, one] as const),
    ],
  ] as const;
  return (
    <table class="two-readings">
      <thead>
        <tr>
          <th scope="col">{`${t("reading.mine", { version: number(mine.version) })} · ${momentOf(mine)}`}</th>
          <th scope="col">{`${reader} · ${momentOf(theirs)}`}</th>
        </tr>
      </thead>
      <tbody>
        <tr class="conclusions">
          {both.map(({ conclusion, template }, at) => (
            <td key={at} dir="auto">
              {conclusion}
              {FIELDS.map(
                (field) =>
                  template[field] && (
                    <p key={field}>{`${t(`template.${field}`)}: ${wordOf(field, template[field])}`}</p>
                  ),
              )}
            </td>
          ))}
        </tr>
      </tbody>
      {groups.map(([words, rows]) => (
        <tbody key={words}>
          <tr>
            <th colSpan={2} scope="rowgroup">
              {words}
            </th>
          </tr>
          {rows.map((pair, at) => (
            <tr key={at}>
              {pair.map((one, side) => (
                <td key={side}>{one && <About finding={one} />}</td>
              ))}
            </tr>
          ))}
        </tbody>
      ))}
    </table>
  );
}

/** A finding in a few words: where it is, and what its reader wrote. */
const About = ({ finding }: { readonly finding: Finding }) => {
  const { side, gyrus, label, note, certainty, depth_mm, is_unconfirmed } = finding;
  const words = [
    is_unconfirmed && t("findings.unconfirmed"),
    t(`side.${side ?? "unknown"}`),
    gyrusWords(gyrus),
    `${number(depth_mm, 1)} mm`,
    certainty && t(`certainty.${certainty}`),
    positionWords(middleOf(finding)),
  ];
  return (
    <>
      <span>{words.filter(Boolean).join(" · ")}</span>
      {[label, note].filter(Boolean).map((text, at) => (
        <p key={at} dir="auto">
          {text}
        </p>
      ))}
    </>
  );
};
