"""A scene at one sample rate as one C99 file: state, parameters, blocks in order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ..blocks.actuator import Tally
from ..core import maths, steps
from ..core.clocks import PARAMS, ROOT, Instance
from ..core.graph import Block, at_rest, kind, pack
from ..errors import SceneError
from ..run.processor import Change, Processor
from .translate import Unit
from .values import C_TYPES, KINDS, Kind, in_single, literal, named

OF_EXPORT = "NUMBER_OF_EXPORT"  # stands for it until all texts are there
OF_DOUBLES = "/* Of doubles, in single precision too. */"
RUNTIME = Path(__file__).with_name("runtime.h")


RUN_HEADS = """\
/* The same as a stimlib_process and a stimlib_set of stimlib.h, of a {n}_state. */
void {n}_run(void *m, const double *x, double *y, int64_t n);
void {n}_run_set(void *m, int parameter, double value, double samples);
"""
RUNS = """
void {n}_run(void *m, const double *x, double *y, int64_t n)
{{
    const double *in[{inputs}];
    double *out[{outputs}];
    int64_t at;
    int k;
    for (at = 0; at < n; at += 1 << 20) {{
        for (k = 0; k < {inputs}; k++) in[k] = x + k * n + at;
        for (k = 0; k < {outputs}; k++) out[k] = y + k * n + at;
        {n}_process(({n}_state *)m, in, out, (int)(n - at < 1 << 20 ? n - at : 1 << 20));
    }}
}}

void {n}_run_set(void *m, int parameter, double value, double samples)
{{
    {n}_set(({n}_state *)m, parameter, value, samples);
}}
"""


Field = tuple[str, str, int | None]
"""A field of the state: its type and name in C; its size if it is an array."""


def words_text(v: np.ndarray, bits: int) -> str:
    """Return numbers of so many bits as the inside of a C array."""
    words = v.astype(f"f{bits // 8}").view(f"u{bits // 8}")
    return _rows(f"UINT{bits}_C(0x{w:0{bits // 4}x})" for w in words.tolist())


def numbers_text(v: np.ndarray) -> str:
    """Return numbers as the inside of a C array, with all their digits."""
    of = np.uint64 if v.dtype == np.uint64 else float
    return _rows(literal(of(n)) for n in v.tolist())


def _rows(texts: Iterable[str]) -> str:
    """Return texts with commas, four in a line."""
    rows = iter(texts)
    return ",\n".join(iter(lambda: ", ".join(islice(rows, 4)), "")) or "0"


def starts(fields: Sequence[Field], words: np.ndarray) -> list[str]:
    """Return the assignments of what is not 0 in the words of these fields."""
    rows, at = [], 0
    for number, name, size in fields:
        part = np.ascontiguousarray(words[at : at + (1 if size is None else size)])
        values, at = part.view(np.uint64 if number == "uint64_t" else np.float64), at + len(part)
        rows += [
            f"m->{name}{'' if size is None else f'[{k}]'} = {literal(values[k])};"
            for k in np.flatnonzero(part.view(np.uint64))
        ]
    return rows


class Writer:
    """The parts of a C file, from the program of a processor."""

    def __init__(self, proc: Processor, name: str, tile: int, single: bool = False) -> None:
        self.proc, self.name, self.tile, self.single = proc, name, tile, single
        self.most = f"{name.upper()}_TILE"  # the name of that number in C
        self.instances, self.design = proc.program.instances, proc.design
        self.begin, self.unit = proc.state[2:], Unit(single)
        self.fields: list[Field] = []  # of the state
        self.constants: list[str] = []
        self.blocks: list[str] = []  # a function for each
        self.body: list[str] = []
        self.slots: dict[Any, int] = {}
        self.scratch = 0
        for i in proc.program.inputs.values():
            self.slot(i)
        for i, q in enumerate(self.instances):
            self.instance(i, q)

    def slot(self, key: Any) -> int:
        """Return the number of a signal's array."""
        return self.slots.setdefault(key, len(self.slots))

    def signal(self, i: int, clock: int) -> int:
        """Return the slot of an argument; on a clock below it is gathered first."""
        q = self.instances[i]
        if q.kind == "pick":
            return self.slot((q.args[0], q.block.output_index))  # type: ignore[attr-defined]
        if q.kind == "const" or clock <= ROOT or (q.clock != PARAMS and q.kind != "input"):
            return self.slot(i)
        if (i, "on", clock) not in self.slots:
            to = self.slot((i, "on", clock))
            self.body.append(
                f"st_gather(m->v[{self.slot(i)}], m->v[{to}], m->top[{clock}], n{clock});"
            )
        return self.slots[i, "on", clock]

    def instance(self, i: int, q: Instance) -> None:
        """Write what runs one instance."""
        if q.kind == "const":
            value, to = literal(float(q.block.value)), self.slot(i)  # type: ignore[attr-defined]
            self.constants.append(f"    for (i = 0; i < {self.most}; i++) m->v[{to}][i] = {value};")
        elif q.kind == "open":
            by = self.signal(q.args[0], q.clock)
            up = "0" if q.clock == ROOT else f"m->top[{q.clock}]"
            places = f"m->place[{q.child}], m->top[{q.child}]"
            self.body.append(f"n{q.child} = st_open(m->v[{by}], {up}, {places}, n{q.clock});")
        elif q.kind == "close":
            inner = self.signal(q.args[1], q.child)
            ends = f"m->v[{inner}], m->v[{self.slot(i)}], m->place[{q.child}]"
            self.body.append(f"st_close({ends}, n{q.child}, n{q.clock});")
        elif q.kind == "block":
            try:
                self.block(i, q)
            except SceneError as e:
                raise SceneError(f"{repr(q.block)[:80]}: {e}") from e

    # One block ------------------------------------------------------------------------
    def block(self, i: int, q: Instance) -> None:
        """Write the function of one block, and its call."""
        cls, (p, s) = q.block.definition, self.design[i]
        inputs = [self.signal(a, q.clock) for a in q.args]
        contact = inputs.pop() if cls.resettable else None
        outputs = (
            [self.slot((i, k)) for k in range(len(cls.outputs))] if cls.outputs else [self.slot(i)]
        )
        first, known = len(self.fields), len(self.unit.functions)
        kinds: list[Kind] = [(type(t), *(KINDS[kind(v)] for v in t)) for t in (p, s)]
        parameters, state = self.numbers(f"p{i}", p, True), self.numbers(f"b{i}", s, False)
        lines = [f"    const {self.unit.type(kinds[0])} p = {parameters};"] if parameters else []
        lines += [f"    {self.unit.type(kinds[1])} s = {state};"] if state else []
        given = [*(["p"] if parameters else []), *(["s"] if state else [])]
        arrays = [f"m->v[{k}] + a" for k in inputs], [f"m->v[{k}] + a" for k in outputs]
        # float32 has no words of 64 bits, C no lanes: what has a step too runs that
        if cls.tile is not None and not (
            cls.step and (self.single or maths.series in steps.names(cls.tile).values())
        ):
            given += [f"st_floats_of({v}, n)" for v in (*arrays[0], *arrays[1])]
            kinds += ["f8*"] * (len(inputs) + len(outputs))
            if cls.work:
                size = int(cls.work(p))
                self.scratch = max(self.scratch, size)
                given.append(f"st_floats_of(m->w, {size})")
                kinds.append("f8*")
            name, _ = self.unit.function(cls.tile, kinds)
            lines.append(f"    {'s = ' if state else ''}{name}({', '.join(given)});")
        else:
            name, result = self.unit.function(cls.step, [*kinds, *["f8"] * len(inputs)])
            given += [f"({v})[i]" for v in arrays[0]]
            lines += ["    int i;", "    for (i = 0; i < n; i++) {"]
            lines.append(f"        const {self.unit.type(result)} t = {name}({', '.join(given)});")
            parts = [f"t.a0.{f}" for f, _ in named(result[1])] if cls.outputs else ["t.a0"]
            lines += [f"        ({v})[i] = {y};" for v, y in zip(arrays[1], parts, strict=True)]
            lines += ["        s = t.a1;", "    }"] if state else ["    }"]
        if state:
            single = [f for f, k in named(kinds[1]) if k in ("f8", "u8")]
            ends = ["0.0" if cls.resettable and f == "cold" else f"s.{f}" for f in single]
            lines += [f"    m->b{i}_{f} = {v};" for f, v in zip(single, ends, strict=True)]
        head = f"static void b{i}({self.name}_state *m, int a, int n)"
        self.blocks.append("\n".join([f"/* {said(q.block)} */", head, "{", *lines, "}", ""]))
        if self.single:
            in_single("\n".join([*self.unit.functions[known:], self.blocks[-1]]))
        call = (
            f"b{i}(m, 0, n{q.clock});"
            if contact is None
            else self.resettable(i, q.clock, self.fields[first:], s, contact, outputs)
        )
        self.body.append(call if q.clock <= ROOT else f"if (n{q.clock} > 0) {call}")

    def resettable(
        self, i: int, clock: int, fields: Sequence[Field], s: Any, contact: int, outputs: list[int]
    ) -> str:
        """Write the stretches of contact of a resettable block; return their call."""
        rows = [
            *(f"memset(m->v[{k}] + a, 0, (size_t)(b - a) * sizeof m->v[0][0]);" for k in outputs),
            f"if (m->b{i}_cold != 0.0) continue;",
            *(f"memset(&m->{name}, 0, sizeof m->{name});" for _, name, _ in fields),
            *starts(fields, pack(at_rest(s))),
        ]
        self.blocks.append(
            f"static void contact{i}({self.name}_state *m, int n)\n{{\n    int a, b;\n"
            f"    for (a = 0; a < n; a = b) {{\n        const int on = m->v[{contact}][a] > 0.0;\n"
            f"        for (b = a + 1; b < n && (m->v[{contact}][b] > 0.0) == on; b++) {{}}\n"
            f"        if (on) {{ b{i}(m, a, b - a); continue; }}\n"
            f"{lines(rows)}\n    }}\n}}\n"
        )
        return f"contact{i}(m, n{clock});"

    def numbers(self, prefix: str, t: Any, constant: bool) -> str:
        """Declare a tuple's numbers; return the text that makes its struct."""
        of, texts = (type(t), *(KINDS[kind(v)] for v in t)), []
        for (f, c), v in zip(named(of), t, strict=True):
            where, is_array, number = f"{prefix}_{f}", c[-1] == "*", C_TYPES[c[:2]]
            if is_array and constant:
                self.constants_of(where, number, v)
            elif not constant and not (is_array and v.size == 0):
                self.fields.append((number, where, v.size if is_array else None))
            if is_array:
                place = where if constant else f"m->{where}"
                place = place if v.size else f"({number} *)0"
                texts.append(f"{C_TYPES[c]}_of({place}, {v.size})")
            else:
                texts.append(literal(v if c == "u8" else float(v)) if constant else f"m->{where}")
        return f"{self.unit.type(of)}_of({', '.join(texts)})" if texts else ""

    def constants_of(self, name: str, number: str, v: np.ndarray) -> None:
        """Write an array of design numbers."""
        if v.size:
            self.unit.functions.append(
                f"static const {number} {name}[] = {{\n{numbers_text(v)} }};\n"
            )

    @property
    def size(self) -> int:
        """Approximate size of the state in bytes."""
        index = 8 * self.tile * len(self.proc.program.parents)
        real = 4 if self.single else 8
        words = sum((8 if of == "uint64_t" else real) * (size or 1) for of, _, size in self.fields)
        words += real * (len(self.slots) * self.tile + self.scratch)
        return words + index * (len(self.proc.program.parents) > ROOT + 1)

    @property
    def limited(self) -> str:
        """The fields of the state that count limited samples, for the header."""
        found = ", ".join(
            f"b{i}_n {q.block.stage} of {q.block.output}"
            for i, q in enumerate(self.instances)
            if isinstance(q.block, Tally)
        )
        return f"   counts of limited samples: {found}\n" if found else ""

    # The whole file -------------------------------------------------------------------
    def files(
        self, x: np.ndarray, y: np.ndarray, changes: Sequence[Change], error: str = ""
    ) -> dict[str, str]:
        """Return header, source and self test, which compares y for the samples x.

        error: for the header, that of single precision.
        """
        n, program, scene = self.name, self.proc.program, self.proc.scene
        inputs, outputs, params = list(program.inputs), list(program.outputs), list(program.params)
        clocks = range(ROOT + 1, len(program.parents))
        index = [
            f"    int place[{len(program.parents)}][{self.most}],"
            f" top[{len(program.parents)}][{self.most}];"
        ] * bool(len(clocks))
        state = [
            f"    {of} {name}{'' if size is None else f'[{size}]'};"
            for of, name, size in self.fields
        ] or ["    double none;"]
        faults = "".join(
            f"(m)->b{i}_left >= 0 ? {k} : " for k, i in enumerate(program.outputs.values(), 1)
        )
        runs = RUNS.format(n=n, inputs=max(1, len(inputs)), outputs=len(outputs))
        run_heads, runs = ("", "") if self.single else (RUN_HEADS.format(n=n), runs)
        header = f"""\
/* {n}: a stimulus at {self.proc.fs:g} Hz, exported by stimlib.
{listed("inputs", inputs, scene.inputs)}
{listed("outputs", outputs, scene.outputs)}
{listed("parameters", params, scene.params)}
{self.limited}{error}\
   The state takes about {self.size} bytes; nothing is allocated, and nothing is global. */
#ifndef STIMLIB_{n.upper()}
#define STIMLIB_{n.upper()}
#include <stdint.h>
#ifdef __cplusplus
extern "C" {{
#endif

#define {n.upper()}_EXPORT {OF_EXPORT} /* the same in all files of an export */
#define {n.upper()}_FS {self.proc.fs!r}
#define {n.upper()}_INPUTS {len(inputs)}
#define {n.upper()}_OUTPUTS {len(outputs)}
{chr(10).join(f"#define {n.upper()}_{p.upper()} {k}" for k, p in enumerate(params))}
/* 1 + the number of an output that fades out, as it was not finite, or 0 */
#define {n.upper()}_FAULT(m) ({faults}0)
#define {self.most} {self.tile} /* samples at a time; the samples do not depend on it */

typedef struct {{
{chr(10).join(state)}
    double v[{max(1, len(self.slots))}][{self.most}], w[{max(1, self.scratch)}];
{chr(10).join(index)}
}} {n}_state;

/* The state at sample 0. */
void {n}_init({n}_state *m);
/* Let a parameter go to a value within so many samples; 0: at once. A value that is not
   finite is not taken. */
void {n}_set({n}_state *m, int parameter, double value, double samples);
/* Compute n samples: in has a row for each input, out one for each output. */
void {n}_process({n}_state *m, const double *const *in, double *const *out, int n);
{run_heads}
#ifdef __cplusplus
}}
#endif
#endif
"""
        counts = " ".join(f"int n{c} = 0;" for c in clocks)
        init, ends = self.constants, [self.slots[i] for i in program.outputs.values()]
        sets = "\n".join(
            f"    case {k}: m->b{i}_target = value; m->b{i}_left = left;"
            f" if (left == 0.0) m->b{i}_y = value; break;"
            for k, i in enumerate(program.params.values())
        )
        begin = starts(self.fields, self.begin)
        runtime, of_doubles = RUNTIME.read_text(encoding="utf-8").split(OF_DOUBLES)
        exact = "\n".join([of_doubles, *self.unit.maths.types, *self.unit.maths.functions])
        source = f"""\
/* Exported by stimlib. */
#include "{n}.h"
{together(n)}
{runtime}
ST_INLINE int st_open(const double *by, const int *up, int *place, int *top, int n)
{{
    int i, k = 0;
    for (i = 0; i < n; i++)
        if (by[i] > 0.0) {{ place[k] = i; top[k++] = up ? up[i] : i; }}
    return k;
}}

ST_INLINE void st_close(const double *inner, double *out, const int *place, int k, int n)
{{
    int i;
    for (i = 0; i < n; i++) out[i] = 0.0;
    for (i = 0; i < k; i++) out[place[i]] = inner[i];
}}

ST_INLINE void st_gather(const double *from, double *to, const int *top, int n)
{{
    int i;
    for (i = 0; i < n; i++) to[i] = from[top[i]];
}}

{OF_DOUBLES}
{chr(10).join(self.unit.types)}

{chr(10).join(self.unit.functions)}
{chr(10).join(self.blocks)}
void {n}_init({n}_state *m)
{{
    int i;
    (void)i;
    memset((void *)m, 0, sizeof *m);
{lines(begin)}
{chr(10).join(init)}
}}

void {n}_set({n}_state *m, int parameter, double value, double samples)
{{
    const double left = samples > 1.0 ? samples : 0.0; /* a jump is there at once */
    (void)m; (void)left;
    if (value - value != 0.0) return;
    switch (parameter) {{
{sets}
    default: break;
    }}
}}

void {n}_process({n}_state *m, const double *const *in, double *const *out, int n)
{{
    int from;
    (void)in;
    for (from = 0; from < n; from += {self.most}) {{
        const int n1 = n - from < {self.most} ? n - from : {self.most}, n0 = n1;
        const size_t bytes = (size_t)n1 * sizeof m->v[0][0];
        {counts}
        (void)n0; (void)bytes;
{lines(f"memcpy(m->v[{k}], in[{k}] + from, bytes);" for k in range(len(inputs)))}
{lines(self.body)}
{lines(f"memcpy(out[{k}] + from, m->v[{i}], bytes);" for k, i in enumerate(ends))}
    }}
}}
{runs}"""
        made = {f"{n}.h": header, f"{n}.c": source, f"{n}_test.c": self_test(self, x, y, changes)}
        if self.single:
            made = {file: in_single(text) for file, text in made.items()}
        made = {file: text.replace(OF_DOUBLES, exact) for file, text in made.items()}
        number = f"0x{sha256(''.join(made.values()).encode()).hexdigest()[:7]}"
        return {file: text.replace(OF_EXPORT, number) for file, text in made.items()}


def together(name: str) -> str:
    """Return the check that a header is of the same export."""
    return (
        f"#if {name.upper()}_EXPORT != {OF_EXPORT}\n"
        f'#error "{name}.h is of another export: export again"\n#endif'
    )


def lines(rows: Iterable[str]) -> str:
    """Return statements inside the loop over tiles."""
    return "\n".join(f"        {row}" for row in rows)


def listed(what: str, names: list[str], blocks: Mapping[str, Block]) -> str:
    """Return a line of the header's comment."""
    return f"   {what}: " + (
        ", ".join(f"{k} {name} [{blocks[name].dim}]" for k, name in enumerate(names)) or "none"
    )


def said(block: Block) -> str:
    """Return the comment of a block, with the source of one of a user."""
    text = repr(block)[:200]
    if not steps.ours(type(block)):
        text += f"\n{steps.source(block.definition.tile or block.definition.step)}"
    return comment(text)


def comment(text: str) -> str:
    """Return a text as the inside of a comment, which nothing in it ends or joins."""
    for end in ("*/", "/*", "??/"):
        text = text.replace(end, " ".join(end))
    return "\n * ".join(line.rstrip("\\ ") for line in text.splitlines())


def self_test(w: Writer, x: np.ndarray, y: np.ndarray, changes: Sequence[Change]) -> str:
    """Return a program that computes the samples and counts differences."""
    n, params, fs = w.name, list(w.proc.program.params), w.proc.fs
    total, ins, outs, bits = y.shape[1], max(1, len(x)), len(y), 32 if w.single else 64
    runs: list[str] = []
    cuts = sorted({0, total // 3, *(c.at for c in changes)})
    for at, end in zip(cuts, [*cuts[1:], total], strict=True):
        runs += [
            f"    {n}_set(&m, {params.index(c.name)}, {literal(float(c.value))},"
            f" {max(1, round(c.ramp * fs))}.0);"
            for c in changes
            if c.at == at
        ]
        runs.append(f"    run({at}, {end});")
    return f"""\
/* Exported by stimlib: compares {n} with its samples, bit by bit; prints how many differ. */
#include "{n}.h"
{together(n)}
#include <stdio.h>
#include <string.h>

static const uint{bits}_t input[] = {{ {words_text(x.ravel(), bits)} }};
static const uint{bits}_t wanted[] = {{ {words_text(y.ravel(), bits)} }};
static {n}_state m;
static double x[{ins}][{total}], y[{outs}][{total}];

static void run(int from, int to)
{{
    const double *in[{ins}];
    double *out[{outs}];
    int k;
    for (k = 0; k < {ins}; k++) in[k] = x[k] + from;
    for (k = 0; k < {outs}; k++) out[k] = y[k] + from;
    {n}_process(&m, in, out, to - from);
}}

int main(void)
{{
    int k, i, differ = 0;
    memcpy(x, input, {bits // 8 * x.size});
    {n}_init(&m);
{chr(10).join(runs)}
    for (k = 0; k < {outs}; k++)
        for (i = 0; i < {total}; i++) {{
            uint{bits}_t bits;
            double want;
            memcpy(&bits, &y[k][i], sizeof bits);
            memcpy(&want, &wanted[k * {total} + i], sizeof bits);
#ifdef STIM_PRINT
            printf("bits: %lx\\n", (unsigned long)bits);
#endif
            if (bits != wanted[k * {total} + i] && !(want != want && y[k][i] != y[k][i])) {{
                if (!differ)
                    printf("output %d, sample %d: %.17g, not %.17g\\n", k, i, y[k][i], want);
                differ++;
            }}
        }}
    printf("%d of %d samples differ\\n", differ, {outs * total});
    return differ != 0;
}}
"""
