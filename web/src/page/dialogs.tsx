// Questions and help in front of the page.

import { type ComponentChildren, render } from "preact";

import { type Holder, type Refusal, isBehindProxy, isByProxy, takeHanded } from "../base/api.ts";
import { caseIdentity } from "../base/case-words.ts";
import { h } from "../base/dom.ts";
import { number, t, wordsBetween } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { ReadyCase } from "../model/case.ts";
import { BINDINGS } from "../model/keys.ts";
import { preferences } from "../store/preferences.ts";
import { Button, Icon, Quiet } from "./fields.tsx";

export const Closing = ({
  value = "close",
  words = t("close"),
  ...rest
}: {
  readonly value?: string;
  readonly words?: string;
  readonly class?: string;
  readonly autofocus?: boolean;
  readonly disabled?: boolean;
}) => (
  <button type="submit" value={value} {...rest}>
    {words}
  </button>
);

/** The buttons at the end of a dialog; the first one that closes it is what Enter does. */
export const End = ({ children }: { readonly children: ComponentChildren }) => <div class="row end">{children}</div>;

/** Shows a dialog, which is gone when it closes; resolves to the value of the button that closed it. */
export function open(
  title: string,
  name: string,
  body: ComponentChildren,
  end: ComponentChildren = <Closing class="primary" autofocus />,
): Promise<string> {
  const dialog = h("dialog", { class: `dialog ${name}`, "aria-labelledby": `${name}-title` });
  render(
    <form method="dialog">
      <h2 id={`${name}-title`}>{title}</h2>
      {body}
      {end && <End>{end}</End>}
    </form>,
    dialog,
  );
  document.body.append(dialog);
  dialog.showModal();
  return new Promise((resolve) =>
    dialog.addEventListener("close", () => {
      render(null, dialog);
      dialog.remove();
      resolve(dialog.returnValue);
    }),
  );
}

/** Whether a user agrees; anything but the button that says so is a no. */
async function confirm(
  name: string,
  title: string,
  text: string,
  no: string,
  yes: string,
  kind = "",
): Promise<boolean> {
  const end = (
    <>
      <Closing value="keep" words={no} autofocus />
      <Closing value={name} words={yes} class={kind} />
    </>
  );
  return (await open(title, `confirm-${name}`, <p>{text}</p>, end)) === name;
}

/** Whether something is to be deleted. */
export const confirmDelete = (title: string, text: string): Promise<boolean> =>
  confirm("delete", title, text, t("delete.keep"), t("delete.do"), "danger");

/** Whether a reading is to be signed; the text says what that locks. */
export const confirmSign = (text: string): Promise<boolean> =>
  confirm("sign", t("reading.ask"), text, t("reading.not-yet"), t("reading.do"), "primary");

/** Whether a case that was there already is to have another label. */
export const confirmRename = (title: string, name: string): Promise<boolean> =>
  confirm(
    "rename",
    t("rename.title"),
    t("rename.text", { title, name }),
    t("rename.keep", { title }),
    t("rename.do", { name }),
  );

/** What files are that were dropped on an open case: `layer`, `case`, or nothing to be sent. */
export const askDropped = (shown: ReadyCase, files: readonly File[]): Promise<string> =>
  open(
    t("drop.title"),
    "dropped",
    [
      <p>{t("drop.text", { title: caseIdentity(shown), count: number(files.length) })}</p>,
      <Quiet>{t("drop.hint")}</Quiet>,
    ],
    <>
      <Closing value="" words={t("upload.cancel")} />
      <Closing value="case" words={t("drop.case")} />
      <Closing value="layer" words={t("drop.layer")} class="primary" autofocus />
    </>,
  );

/** Which of some volumes are to be added as layers: their numbers, from 0. */
export async function offerLayers(titles: readonly string[]): Promise<readonly number[]> {
  const wanted = new Set(titles.keys());
  const boxes = titles.map((title, at) => (
    <label class="inline">
      <input
        type="checkbox"
        defaultChecked
        onChange={({ currentTarget }) => wanted[currentTarget.checked ? "add" : "delete"](at)}
      />
      {title}
    </label>
  ));
  const answer = await open(
    t("offer.title"),
    "offer",
    [<Quiet>{t("offer.text")}</Quiet>, ...boxes],
    <>
      <Closing value="add" words={t("offer.add")} class="primary" />
      <Closing value="" words={t("offer.skip")} />
    </>,
  );
  return answer === "add" ? [...titles.keys()].filter((at) => wanted.has(at)) : [];
}

/** Asks for a short text; empty if it is not to be changed. */
export async function askText(title: string, label: string, value: string): Promise<string> {
  let typed = value;
  const field = (
    <label>
      {label}
      <input
        type="text"
        id="text"
        maxLength={64}
        autocomplete="off"
        defaultValue={value}
        onInput={({ currentTarget }) => (typed = currentTarget.value)}
      />
    </label>
  );
  const end = (
    <>
      <Closing value="enter" words={t("rename.enter")} class="primary" />
      <Closing value="" words={t("delete.keep")} />
    </>
  );
  return (await open(title, "ask-text", field, end)) === "enter" ? typed.trim() : "";
}

/** Asks for the token that the server requires, or lets its user sign in; empty if none was typed, null if a proxy may know the user. */
export async function askToken({ problem, hadToken }: Refusal): Promise<string | null> {
  // The page that opens a case from a PACS hands on what was typed there, once.
  const handed = takeHanded().token;
  if (handed) return handed;
  const byProxy = await isBehindProxy();
  let typed = "";
  const field = (
    <label>
      {t("token.label")}
      <input
        type="password"
        autocomplete="off"
        required={!byProxy}
        id="token"
        onInput={({ currentTarget }) => (typed = currentTarget.value)}
      />
    </label>
  );
  const enter = <Closing value="enter" words={t("token.enter")} class={byProxy ? "" : "primary"} />;
  if (!byProxy) {
    const text = <Quiet>{t(hadToken ? "token.refused" : "token.text")}</Quiet>;
    await open(t("token.title"), "ask-token", [text, field], enter);
    return typed.trim();
  }
  // Whoever signs in at the proxy does so in a window of its own; this page stays as it is.
  const isRefused = hadToken || problem.kind === "proxy-refused";
  const body = (
    <>
      <Quiet>{isRefused ? problemWords(problem) : t("sign-in.proxy")}</Quiet>
      <div class="row">
        <a href="./" target="_blank" rel="noopener" id="sign-in">
          {t("sign-in.enter")}
        </a>
        <Closing value="again" words={t("sign-in.again")} class="primary" autofocus />
      </div>
      <details>
        <summary>{t("sign-in.token")}</summary>
        {field}
        <End>{enter}</End>
      </details>
    </>
  );
  return (await open(t("sign-in.title"), "ask-proxy", body, null)) === "again" ? null : typed.trim();
}

/** Says who is signed in and what they may do, and lets them sign out. */
export function holderDialog(name: string, holder: Holder): void {
  const { scopes, sign_out } = holder;
  // Whom a proxy knows would be signed in again at once; loading the page again forgets a token.
  const canLeave = !isByProxy(holder) || sign_out !== undefined;
  const leave = (): void => location.assign(sign_out ?? "./");
  const may = scopes.length > 0 ? t("who.may", { scopes: scopes.join(", ") }) : t("problem.missing-scope");
  void open(
    t("who.title"),
    "holder",
    [<p id="holder">{t("who.as", { name })}</p>, <Quiet>{may}</Quiet>],
    <>
      {canLeave && (
        <Button id="sign-out" onClick={leave}>
          {t("who.out")}
        </Button>
      )}
      <Closing class="primary" autofocus />
    </>,
  );
}

export function helpDialog(): void {
  // Each line is "how|what it is for"; what has no such parts is the title of those after it.
  const keys = BINDINGS.map(({ help, keys: those }) => {
    const how = typeof those === "string" ? t(`key.${those}`) : those.join(", ");
    return [how, t(`help.key-${help}`)];
  });
  const sections: { readonly title: string; readonly lines: (readonly [string, string])[] }[] = [];
  const hands = wordsBetween("help.mouse", "help.keys").map((words) => words.split("|"));
  for (const [how = "", what] of [...hands, [t("help.keys")], ...keys]) {
    if (what === undefined) sections.push({ title: how, lines: [] });
    else sections.at(-1)?.lines.push([how, what.replace("{use}", t(`wheel.${preferences.peek().wheel}`))]);
  }
  void open(
    t("help.title"),
    "help",
    <>
      {/* The first choice would scroll the help away where it does not fit. */}
      <button type="submit" class="icon-button" aria-label={t("close")} title={t("close")} autofocus>
        <Icon name="close" />
      </button>
      <p>{t("help.intro")}</p>
      <div class="help-columns">
        {sections.map(({ title, lines }) => (
          <section>
            <h3>{title}</h3>
            <dl class="help-list">{lines.map(([how, what]) => [<dt>{how}</dt>, <dd>{what}</dd>])}</dl>
          </section>
        ))}
      </div>
      <Quiet>{t("help.mirror")}</Quiet>
      <Quiet>{t("help.slices")}</Quiet>
      <Quiet>{`${t("help.letters")} ${t("letters.legend")}`}</Quiet>
      <Quiet>{t("help.zero")}</Quiet>
      <Quiet>{t("notice.long")}</Quiet>
    </>,
    <Closing class="primary" />,
  );
}
