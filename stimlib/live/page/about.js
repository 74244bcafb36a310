// What a page says of its scene: what to do, what is felt, the law as a formula, and its sources. protocol.py has the fields.

const $ = id => document.getElementById(id);
const GREEK = { alpha: "α", chi: "χ", gamma: "γ", mu: "µ", pi: "π", tau: "τ" };
const UNIT = "[ACFHJKNTVWgms]"; // what a letter after a number is
const TOKENS = new RegExp([
  String.raw`(?<mark>(?:\^|(?<=\b(?:[A-Za-z]|${Object.keys(GREEK).join("|")}))_)(?:\w+|\([^()]*\)))`, // no underscore of a longer name
  String.raw`\b(?<greek>${Object.keys(GREEK).join("|")})(?=_|\b)`,
  String.raw`(?<!['’] ?|\d ?(?=${UNIT}))\b(?<letter>a(?! [a-z])|[A-Zb-z])(?=_|\b)(?!')`,
  String.raw`(?<root>\bsqrt\b)`,
  String.raw`(?<minus> - )|(?<sign>(?<=\()-(?=\w))`,
].join("|"), "g");

function element(parent, tag, textContent = "") { return Object.assign(parent.appendChild(document.createElement(tag)), { textContent }); }

/** The parts of a law's text: {formula, words, source}; what is not there is "". */
export function parted(text) {
  let end = text.length, depth = 0;
  if (text.endsWith(")"))
    do depth += { ")": 1, "(": -1 }[text[--end]] ?? 0; while (depth && end);
  const said = text.slice(0, end).trim(), source = text.slice(end + 1, -1);
  let at = said.length;
  depth = 0;
  for (let k = 0; k < said.length && at === said.length; k++) {
    depth += { "(": 1, ")": -1 }[said[k]] ?? 0;
    if (!depth && /^(?:; |, (?!else ))/.test(said.slice(k))) at = k;
  }
  const formula = said.slice(0, at).includes(" = ") ? said.slice(0, at) : "";
  return { formula, words: formula ? said.slice(at + 2) : said, source };
}

/** Writes a text with formulas: Greek letters by their signs, powers raised, and letters that are no word slanted, but for units. */
export function write(parent, text, slanted = true) {
  let at = 0;
  for (const { 0: found, index, groups: { mark, greek, letter, minus, sign } } of text.matchAll(TOKENS)) {
    parent.append(text.slice(at, index));
    at = index + found.length;
    if (mark) write(element(parent, mark[0] === "^" ? "sup" : "sub"), mark.slice(1), slanted);
    else if (greek || letter) element(parent, slanted ? "i" : "span", GREEK[greek] ?? letter);
    else parent.append(minus ? " − " : sign ? "−" : "√");
  }
  parent.append(text.slice(at));
  return parent;
}

/** Fills the page with `hello`. */
export function introduce({ about, inputs, alone }) {
  $("felt").textContent = about.felt.join(" ");
  const does = about.do || (inputs.length ? "move a finger over the field" : "turn the sound on");
  $("do").textContent = `Press Start and ${does}${alone === "with motion" ? "; or play the recorded motion" : ""}.`;
  $("laws").replaceChildren();
  for (const text of about.laws) {
    const { formula, words, source } = parted(text);
    if (formula) write(element($("laws"), "p"), formula).className = "formula";
    if (words) write(element($("laws"), "p"), `${words.replace(/^\w{2}/, start => (formula ? start : start[0].toUpperCase() + start[1]))}.`);
    if (source) element($("laws"), "p", `Source: ${source}.`).className = "hint";
  }
  $("sources-of").replaceChildren();
  for (const text of about.sources) element($("sources-of"), "li", text);
  $("fixed").replaceChildren();
  for (const { name, value, meaning } of about.fixed) {
    const item = element($("fixed"), "li");
    element(item, "b", value ? `${name} = ${value}` : name);
    item.append(`: ${meaning}`);
  }
  $("of-fixed").hidden = !about.fixed.length;
  $("about").hidden = !about.laws.length;
  $("h-papers").hidden = !about.sources.length;
}
