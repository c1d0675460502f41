"""The page in the browser: the answers of the command line, without a server and without a network."""

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from bench import makers
from exports import FORMS

import glapp
from glapp.reading import open_recordings
from glapp.reading.columns import LABELS
from glapp.report import words
from glapp.simulate import closed_loop

CHROMIUM = shutil.which("chromium")
if CHROMIUM is None:
    pytest.skip("chromium is not installed", allow_module_level=True)
sync_api = pytest.importorskip("playwright.sync_api")
PAGE = Path(__file__).parents[1] / "dist" / "page" / "index.html"
pytestmark = [
    pytest.mark.verify,
    pytest.mark.skipif(not PAGE.is_file(), reason="the page is not made: make page tells what that needs"),
    pytest.mark.xdist_group("page in the browser"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        one = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield one
        one.close()


@pytest.fixture(scope="module")
def page(browser: Any) -> Any:
    """The page from the disk, opened once for all tests, its requests and its errors."""
    one = browser.new_context(viewport={"width": 1280, "height": 800}, offline=True).new_page()
    one.set_default_timeout(600_000)  # a fit may wait long for its processor
    one.asked, one.wrong = [], []
    one.on("request", lambda request: one.asked.append(request.url))
    one.on("pageerror", lambda error: one.wrong.append(str(error)))
    one.on("console", lambda message: one.wrong.append(message.text) if message.type == "error" else None)
    one.goto(PAGE.as_uri())
    # The view before the fit is kept, to be looked at later.
    one.evaluate("""() => {
        const first = hears.first;
        hears.first = (said) => {
            first(said);
            const canvases = $("result").querySelectorAll("canvas").length;
            globalThis.before = { said, text: $("result").innerText, canvases };
        };
    }""")
    return one


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A worn valve in a loop that is quick enough for a fit of few rows, and the same without OP."""
    folder = tmp_path_factory.mktemp("loops")
    acting = {"setpoint": [(1, 1.0)], "load": [(20, 0.3), (40, -0.2)]}
    sim = closed_loop("P3", (0.48, 0.3117), d=0.05, noise=0.005, h=0.1, t_end=70, seed=1, **acting)
    for name, columns in (("worn", ("t", "SP", "PV", "OP")), ("without", ("t", "SP", "PV"))):
        rows = zip(*(getattr(sim, column.lower()) for column in columns), strict=True)
        text = "\n".join([",".join(columns), *(",".join(map(repr, map(float, row))) for row in rows)])
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture
def analysed(page: Any, recordings: Path) -> Any:
    """The page with the answer of the worn valve on it."""
    page.click("#go-recording")
    if page.evaluate(
        "() => document.querySelector('#result .loop:not(.provisional)') === null || file.name !== 'worn.csv'"
    ):
        answered(page, recordings / "worn.csv")
    return page


def drop(page: Any, path: Path) -> None:
    """Gives a file to the page, on which nothing of the last one is left to be taken for its answer."""
    page.click("#go-recording")
    page.evaluate("() => { $('result').replaceChildren(); $('wrong').hidden = true; $('file').value = ''; }")
    page.set_input_files("#file", str(path))


def answered(page: Any, path: Path) -> dict[str, Any]:
    """Answer of the page on a file."""
    drop(page, path)
    page.wait_for_selector("#result .loop:not(.provisional), #wrong:not([hidden])")
    assert not page.locator("#wrong").is_visible(), page.locator("#wrong").inner_text()
    found: dict[str, Any] = page.evaluate("() => shown.answer")
    return found


def near(ours: Any, theirs: Any, at: str) -> None:
    """Equal names, and numbers to 1e-3: a search ends where the last digits of logarithms send it."""
    if isinstance(ours, dict):
        assert ours.keys() == theirs.keys(), at
        for key in ours:
            near(ours[key], theirs[key], f"{at}.{key}")
    elif isinstance(ours, float):
        assert theirs == pytest.approx(ours, rel=1e-3, abs=1e-12), at
    else:
        assert ours == theirs, at


def same(page: Any, path: Path) -> None:
    """Compare the page with the command line on the same file, in numbers and in words."""
    found = page.evaluate("() => shown.answer")
    [recording] = open_recordings(path)
    result = glapp.analyze(recording)
    document = json.loads(json.dumps(result.to_dict()))
    for key in ("verdict", "width", "low", "high", "urgency", "valve", "evidence"):
        near(document["answer"][key], found["answer"][key], key)
    for key in ("crossings", "d_hat", "detections", "half_periods", "noise_floor", "reasons"):
        near(document[key], found[key], key)
    for ours, theirs in zip(document["quality"], found["quality"], strict=True):
        near(ours["evidence"], {key: theirs["evidence"][key] for key in ours["evidence"]}, ours["code"])
    text = page.locator("#result").text_content()  # also what is folded
    sentences = [words.next_step(result), *(words.sentence(one.text) for one in result.quality)]
    if result.fit is not None:
        sentences += [words.lead(result), words.sentence(result.fit.reason)]
    else:
        sentences.append(words.sentence(result.reason))
    for sentence in sentences:
        assert sentence in text, sentence
    assert page.wrong == []


def test_the_answer_of_the_command_line(analysed: Any, recordings: Path) -> None:
    same(analysed, recordings / "worn.csv")
    assert analysed.locator("#result canvas").count() == 3  # OP and PV over time, the likelihood
    # The sentences of the crossings stood there before, with their pictures.
    before = analysed.evaluate("() => before")
    assert before["said"]["answer"]["fit"] is None and before["canvases"] == 2
    assert before["said"]["answer"]["crossings"] == analysed.evaluate("() => shown.answer.crossings")
    assert "goes on, and settles the width" in before["text"]
    assert analysed.locator(".gap-picture .fitted").count() == 1


def test_the_answer_without_op(page: Any, recordings: Path) -> None:
    answered(page, recordings / "without.csv")
    same(page, recordings / "without.csv")


def test_nothing_is_asked_of_anybody(analysed: Any) -> None:
    page = analysed
    page.click("#go-laboratory")
    page.wait_for_function("() => Number(document.getElementById('laboratory').dataset.t) > 1")
    page.click("#go-recording")
    assert {url.split(":")[0] for url in page.asked} <= {"file", "blob", "data"}
    assert [url for url in page.asked if url.startswith("file")] == [PAGE.as_uri()]
    assert page.wrong == []
    # No script in the page could send anything either.
    blocked = page.evaluate("""async () => {
        const told = [];
        document.addEventListener("securitypolicyviolation", (event) => told.push(event.effectiveDirective));
        await fetch("http://127.0.0.1:9/").catch(() => null);
        new Image().src = "http://127.0.0.1:9/x.png";
        navigator.sendBeacon("http://127.0.0.1:9/", "x");
        try { new WebSocket("ws://127.0.0.1:9/"); } catch {}
        for (let k = 0; k < 100 && told.length < 4; k += 1) await new Promise(requestAnimationFrame);
        return told;
    }""")
    assert set(blocked) == {"connect-src", "img-src"} and blocked.count("connect-src") >= 3
    page.wrong.clear()  # the browser has told each of these


@pytest.mark.parametrize("form", ["excel", "excel_datalink", "german_rows", "parquet", "feather_file", "bzipped"])
def test_forms_of_export_are_read(page: Any, tmp_path: Path, form: str) -> None:
    """The reader's result for every form is compared with the package in node: here it is shown in the page."""
    export = FORMS[form][1]()
    path = tmp_path / f"{form}{export.ending}"
    path.write_bytes(export.content)
    answered(page, path)
    assert page.evaluate("() => Array.from(shown.read.columns.pv)") == export.pv.tolist()
    assert page.locator("#result h2").inner_text() == export.loop
    text = page.locator("#result").inner_text()
    assert ("Each signal has times of its own" in text) == (export.finding == "own_times")


def test_what_is_hidden_in_a_name_is_shown(page: Any, recordings: Path, tmp_path: Path) -> None:
    text = (recordings / "without.csv").read_text(encoding="utf-8")
    path = tmp_path / "FIC\u202e1\u200b.csv"
    path.write_text(text, encoding="utf-8")
    answered(page, path)
    assert page.locator("#result h2").inner_text() == r"FIC\u202e1\u200b"
    assert not re.search("[\u200b\u202e]", page.evaluate("() => document.documentElement.innerText"))
    (tmp_path / "no\u202e.csv").write_text("A,B\n1,2\n", encoding="utf-8")
    drop(page, tmp_path / "no\u202e.csv")
    page.wait_for_selector("#wrong:not([hidden])")
    assert page.locator("#wrong").inner_text().startswith(r"no\u202e.csv: ")


def test_a_file_that_cannot_be_read_says_why(page: Any, tmp_path: Path) -> None:
    (tmp_path / "odd.csv").write_text(
        "t,A,B\n" + "".join(f"{k},{k % 7},{k % 5}\n" for k in range(200)), encoding="utf-8"
    )
    drop(page, tmp_path / "odd.csv")
    page.wait_for_selector("#wrong:not([hidden])")
    assert page.locator("#wrong").inner_text() == (
        "odd.csv: no column for PV and OP among those left: A, B (time is t): choose them below"
    )
    # The settings can be changed there, beside the first rows.
    cells = page.locator("#first-rows tr").evaluate_all(
        "(rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent))"
    )
    assert cells == [["t", "A", "B"], *([str(k), str(k % 7), str(k % 5)] for k in range(5))]
    page.locator("#columns label", has_text="PV").locator("select").select_option("1")
    page.locator("#columns label", has_text="SP").locator("select").select_option("2")
    page.click("#again button[type=submit]")
    page.wait_for_selector("#result .loop:not(.provisional)")


def chooser(page: Any, label: str) -> Any:
    """The field beside a label of the choice of columns."""
    return page.locator(f"xpath=//div[@id='columns']/label[text()='{label}']/select")


@pytest.mark.parametrize("form", ["no_names", "wincc_table_control", "american_ambiguous"])
def test_what_a_file_leaves_open_is_chosen_below_its_refusal(page: Any, tmp_path: Path, form: str) -> None:
    export = makers.FORMS[form].make()
    path = tmp_path / f"{form}{export.ending}"
    path.write_bytes(export.content)
    drop(page, path)
    page.wait_for_selector("#wrong:not([hidden])")
    for role, column in export.answer.get("columns", {}).items():
        chooser(page, LABELS[role]).select_option(label=column)
    if order := export.answer.get("time_format"):
        chooser(page, "Dates such as 3/4/2025").select_option(label=order)
    page.click("#again button[type=submit]")
    page.wait_for_selector("#result .loop:not(.provisional)")
    assert page.evaluate("() => Array.from(shown.read.columns.op)") == export.op.tolist()
    assert page.wrong == []


def test_each_loop_of_a_file_can_be_seen_and_has_settings_of_its_own(page: Any, tmp_path: Path) -> None:
    """A file of several loops showed the first, and nothing said so; the gain of one loop was used for the next."""
    rows = [f"{k},50,{50 + k % 7},{40 + k % 5}" for k in range(300)]
    both = [f"{row},60,{60 + k % 5},{30 + k % 3}" for k, row in enumerate(rows)]
    for name, lines in (
        ("one", ["t,F1.SP,F1.PV,F1.OP", *rows]),
        ("two", ["t,F1.SP,F1.PV,F1.OP,F2.SP,F2.PV,F2.OP", *both]),
    ):
        (tmp_path / f"{name}.csv").write_text("\n".join(lines), encoding="utf-8")
    answered(page, tmp_path / "one.csv")
    assert not page.locator("#several").is_visible()
    page.evaluate("() => { $('settings').open = true; }")
    page.fill("#pv_low", "0")
    page.fill("#pv_high", "1,5")
    page.click("#again button[type=submit]")
    page.wait_for_selector("#result .loop:not(.provisional) :text('beyond its span of 0 to 1.5')")
    answered(page, tmp_path / "two.csv")
    assert "Loop, one of 2 in the file" in page.locator("#several").inner_text()
    assert (page.locator("#result h2").inner_text(), page.input_value("#pv_high")) == ("F1", "1,5")
    page.select_option("#loop", label="F2")
    page.wait_for_selector("#result .loop:not(.provisional) h2:text('F2')")
    assert page.input_value("#pv_high") == ""
    assert page.evaluate("() => Array.from(shown.read.columns.op)")[:4] == [30, 31, 32, 30]
    page.select_option("#loop", label="F1")
    page.wait_for_selector("#result .loop:not(.provisional) h2:text('F1')")
    assert page.input_value("#pv_high") == "1,5"


def test_what_is_given_and_not_used_is_refused(analysed: Any, recordings: Path, tmp_path: Path) -> None:
    """The second file of a drop, a folder and a TD without K were passed over without a word."""
    page = analysed
    page.evaluate("() => { $('settings').open = true; }")
    page.fill("#td", "2")
    page.click("#again button[type=submit]")
    assert page.locator("#wrong").inner_text() == "worn.csv: TD: give K and TI with it, or leave it empty"
    page.fill("#td", "")
    page.evaluate("() => noted.clear()")
    told = page.evaluate("""async () => {
        const told = [];
        const two = new DataTransfer();
        for (const name of ["a.csv", "b.csv"]) two.items.add(new File(["t,PV"], name));
        const folder = [{ name: "exports", arrayBuffer: () => Promise.reject(new Error("no file")) }];
        for (const files of [two.files, folder]) {
            await given(files);
            told.push($("wrong").innerText);
        }
        return told;
    }""")
    assert told == [
        "2 files: one recording is read at a time: drop one of them",
        "exports: cannot be read (no file): drop a file, from a place that this computer can read",
    ]


def test_it_is_ended_when_asked(page: Any, recordings: Path) -> None:
    page.evaluate("() => { $('settings').open = false; }")
    drop(page, recordings / "worn.csv")
    page.wait_for_function("() => fitting?.workers.length > 0")
    page.evaluate("() => { globalThis.ended = [worker, ...fitting.workers]; ended.count = 0; }")
    page.evaluate("""() => {
        for (const one of ended) {
            const terminate = one.terminate.bind(one);
            one.terminate = () => { ended.count += 1; terminate(); };
        }
    }""")
    page.click("#cancel")
    page.wait_for_selector("#settings[open]")
    assert page.evaluate("() => ended.count === ended.length && fitting === null")
    assert not page.locator("#working").is_visible()
    assert page.locator("#result .loop:not(.provisional)").count() == 0
    assert "The fit of OP and PV was ended" in page.locator("#result").inner_text()


@pytest.fixture(scope="module")
def window(page: Any) -> Any:
    """A window of a short fit, where the page can use it, and its result alone."""
    sim = closed_loop("P3", (0.48, 0.3117), d=0.05, noise=0.005, h=0.1, t_end=15, seed=1, setpoint=[(1, 1.0)])
    columns = {"t": sim.t.tolist(), "sp": sim.sp.tolist(), "pv": sim.pv.tolist(), "op": sim.op.tolist()}
    page.evaluate(
        """async (columns) => {
            const engine = await Engine.of(await module_ready);
            for (const [name, numbers] of Object.entries(columns)) engine.column(name, numbers);
            engine.ask("begin", { task: { controller: { k: 0.48, ti: 0.3117, td: 0, b: 1 } } });
            engine.ask("rows", { from: 0, to: columns.t.length });
            const [one] = engine.ask("windows");
            globalThis.window_of_fit = { one, alone: engine.ask("alone", { window: one }) };
        }""",
        columns,
    )
    return page


@pytest.mark.parametrize("processors", [1, 2, 8])
def test_windows_are_fitted_side_by_side_with_the_same_bits(window: Any, processors: int) -> None:
    found = window.evaluate(
        """async (processors) => {
            const { one, alone } = window_of_fit;
            Object.defineProperty(navigator, "hardwareConcurrency", { value: processors, configurable: true });
            const stages = [];
            const progress = hears.progress;
            hears.progress = (said) => { stages.push(said.stage); progress(said); };
            const begun = worker;
            try {
                const so_far = [];
                const joined = new Promise((done) => {
                    worker = {
                        postMessage: (said) => {
                            if (said.so_far === undefined) done(said);
                            else so_far.push([said.so_far, said.alone.filter((alone) => alone !== null).length]);
                        },
                    };
                });
                await fit_windows({ windows: [one, one, one], turn });
                const workers = fitting.workers.length;
                const said = await joined;
                const same = said.alone.length === 3 && said.alone.every((bytes) => String(bytes) === String(alone));
                return { workers, same, kind: said.kind, left: fitting?.workers.length ?? 0, stages, so_far };
            } finally {
                worker = begun;
                hears.progress = progress;
                delete navigator.hardwareConcurrency;
                rest();
            }
        }""",
        processors,
    )
    stages = [f"Fitting the gap, {done} of 3 windows done" for done in range(4)]
    expected = {"same": True, "kind": "join", "left": 0, "stages": [*stages, "Joining what the windows say"]}
    expected["so_far"] = [[1, 1], [2, 2]]
    assert found == expected | {"workers": min(3, processors)}


def test_what_the_windows_say_so_far_is_shown_until_all_are_done(analysed: Any) -> None:
    """Progress as a worker reports it; a recording of two windows would take a minute."""
    found = analysed.evaluate("""() => {
        const said = { ...shown, windows: 1, of: 6 };
        const look = () => ({ told: $("result").innerText, saved: document.getElementById("save") !== null });
        const late = look();
        fitting = { end() {} };
        hears.so_far(said);
        const so_far = look();
        dismiss();
        rest();
        const ended = look();
        hears.answered(said);
        hears.so_far(said);
        return { late, so_far, ended, all: look() };
    }""")
    from_one = "From zero crossings, and from 1 of the 6 windows of the fit. The fit of OP and PV"
    assert f"{from_one} goes on, and settles the width." in found["so_far"]["told"] and not found["so_far"]["saved"]
    assert f"{from_one} was ended." in found["ended"]["told"]
    assert "The fit of OP and PV" not in found["all"]["told"] and found["all"] == found["late"]


@pytest.mark.parametrize("how", ["dies", "cannot be fitted", "reads"])
def test_a_worker_that_breaks_off_ends_the_fit_with_a_word(window: Any, how: str) -> None:
    window.evaluate(
        """async (how) => {
            const { one } = window_of_fit;
            if (worker === null) await begin();
            file ??= { name: "worn.csv" };
            $("wrong").hidden = true;
            await fit_windows({ windows: [how === "cannot be fitted" ? one.slice(0, 9) : one, one], turn });
            const dies = { dies: fitting.workers[0], reads: worker }[how];
            dies?.dispatchEvent(new ErrorEvent("error", { message: "out of memory" }));
        }""",
        how,
    )
    window.wait_for_selector("#wrong:not([hidden])")
    text = window.locator("#wrong").inner_text()
    assert f"the {'analysis' if how == 'reads' else 'fit'} broke off (" in text and "analyse again" in text
    assert ("out of memory" in text) == (how != "cannot be fitted")
    assert window.evaluate("() => fitting === null")
    assert not window.locator("#working").is_visible()


def test_the_report_is_a_file_of_its_own(analysed: Any, browser: Any, tmp_path: Path) -> None:
    with analysed.expect_download() as download:
        analysed.click("#save")
    path = tmp_path / "report.html"
    download.value.save_as(path)
    text = path.read_text(encoding="utf-8")
    assert "<script" not in text and "default-src 'none'" in text
    other = browser.new_context().new_page()
    other.goto(path.as_uri())
    assert "has a dead band of" in other.locator(".lead").inner_text()
    assert other.evaluate("() => [...document.images].every((one) => one.naturalWidth > 100)")
    other.context.close()


def test_a_link_opens_the_laboratory_with_its_settings(browser: Any) -> None:
    for link, d, refused in (("gap.d=4&noise.amplitude=0", "4", ""), ("gap.d=-1&pid.k=1", "2", "gap: d = -1: must be")):
        page = browser.new_context(offline=True).new_page()
        page.set_default_timeout(600_000)
        page.goto(f"{PAGE.as_uri()}#laboratory?{link}")
        page.wait_for_function("() => Number(document.getElementById('laboratory').dataset.t) > 1")
        page.locator("#lab-all summary").click()
        page.fill("#lab-search", "gap.")
        # The values are filled in with the next picture.
        page.wait_for_function("(d) => document.querySelector(\"[aria-label='gap.d']\").value === d", arg=d)
        assert page.locator("#lab-wrong").inner_text().startswith(refused)
        assert page.locator("#lab-wrong").is_hidden() == (not refused)
        page.close()


def test_the_laboratory(page: Any) -> None:
    page.bring_to_front()  # a page behind another draws no pictures
    page.click("#go-laboratory")
    # The laboratory opens with an estimate, after 1000 simulated seconds.
    page.locator("#lab-facts div", has_text="Estimate").get_by_text("1.95").wait_for()
    page.click("#lab-anew")
    # A short record: its fit has one thread, and a tenth of the speed that it has elsewhere.
    page.click("[data-speed='10']")
    page.wait_for_function("() => Number(document.getElementById('laboratory').dataset.t) > 12")
    page.click("#lab-run")
    page.click("#lab-fit")
    page.get_by_text("the true gap is 2\N{NO-BREAK SPACE}%OP").wait_for()
    page.click("#lab-run")
    page.click("[data-speed='1000']")
    page.wait_for_function("() => Number(document.getElementById('laboratory').dataset.t) > 1000")
    page.click("#lab-run")
    # A longer record takes longer; whoever does not want to wait ends the fit.
    page.click("#lab-fit")
    page.get_by_text("Fitting the last").wait_for()
    page.get_by_role("button", name="End the fit").click()
    assert page.locator("#lab-fitted").inner_text() == "The fit was ended."
    assert page.locator("#lab-fit").inner_text() == "Fit what is recorded"
    estimate = page.locator("#lab-facts div", has_text="Estimate").locator("dd").inner_text()
    assert 1.6 < float(estimate.split("\N{NO-BREAK SPACE}")[0]) < 2.2  # a gap of 2.0 %: thesis 6.5 shows 1.8 %
    assert page.locator("#lab-halves tr").count() == 6
    # Every variable is there, and what may be set can be, within its bounds.
    page.locator("#lab-all summary").click()
    page.fill("#lab-search", "gap.")
    page.locator("[aria-label='gap.d']").fill("3")
    page.locator("[aria-label='gap.d']").press("Enter")
    page.wait_for_function("() => document.querySelector(\"[aria-label='gap.d']\").value === '3'")
    page.locator("[aria-label='gap.d']").fill("-3")
    page.locator("[aria-label='gap.d']").press("Enter")
    page.wait_for_selector("#lab-wrong:not([hidden])")
    assert "d = -3" in page.locator("#lab-wrong").inner_text()
    # Compensation comes into force.
    page.check("#lab-compensate")
    page.click("#lab-run")
    page.wait_for_function("() => !/not enabled/.test(document.getElementById('lab-facts').textContent)")
    assert page.wrong == []
