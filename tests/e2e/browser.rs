//! The page in a real browser, on a real set. Needs Chromium; without it these tests say that they were skipped.

use std::path::Path;

use serde_json::json;
use supersigma_tests::{Browser, Cell, Running, Signal};

const EXE: &str = env!("CARGO_BIN_EXE_ccu");

/// A server for the cell's set, and where it is.
fn serve(cell: &Cell, options: &str) -> (Running, String) {
    let mut server = cell.start(&format!("serve --listen 0 {options}"));
    let line = server.line_with("http://");
    let url = line.split(' ').find(|word| word.starts_with("http://")).expect("an address");
    (server, url.to_owned())
}

/// Ends a server as Ctrl-C does.
fn end(server: Running) {
    server.signal(Signal::INT);
    server.end().done();
}

/// An axis on the page.
fn axis(number: u8, is: &str) -> String {
    format!("!!document.querySelector('[data-axis=\"{number}\"]')?.matches('{is}')")
}

const CONNECTED: &str = "document.body.dataset.state === 'up' && document.querySelectorAll('#rows [data-alive=\"true\"]').length === 7";

#[test]
fn the_page_shows_the_set_as_it_is() {
    let Some(mut browser) = Browser::start() else { return };
    let cell = Cell::new(EXE);
    let _ = cell.up("20");
    let (server, url) = serve(&cell, "");
    browser.looks(1280, 800, true);
    browser.open(&url);
    browser.until("seven axes that are connected", CONNECTED);
    browser.until("the set's name", "document.getElementById('name').textContent === 'cell'");
    browser.until("an unknown position", &axis(7, "[data-position=unknown]"));

    cell.ccu("origin wrist").done();
    cell.ccu("move wrist 1234").done();
    browser.until("where it has moved to", &axis(7, "[data-position=\"1234\"][data-activity=standing]"));
    let row = "document.querySelector('[data-axis=\"7\"]')";
    browser.until(
        "the position in digits",
        &format!("{row}.querySelector('.position').innerText === '1\\u202f234'"),
    );
    let lamps =
        format!("[...{row}.querySelectorAll('.lamp')].map((lamp) => lamp.getAttribute('aria-label'))");
    assert_eq!(
        browser.evaluate(&lamps),
        json!([
            "X1, lower limit zone: off",
            "X2, upper limit zone: off",
            "X3, reference step: off",
            "X4, motion complete: on",
            "X5, slower than S1: off",
        ])
    );
    let ink = format!(
        "(() => {{ const [canvas] = {row}.querySelectorAll('canvas');
        const {{ data }} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        return data.some((value) => value > 0); }})()"
    );
    browser.until("a curve", &ink);

    cell.ccu("output lamp on").done();
    browser.until("the lamp", "document.querySelector('[data-line=lamp]')?.dataset.on === 'true'");

    cell.ccu("inject left_x force").done();
    browser.until("the alarm", &axis(1, "[data-alarm=excessive_force]"));
    let words = "document.querySelector('[data-axis=\"1\"] .alarm').innerText === 'locked: excessive force'";
    browser.until("the alarm in words", words);
    browser.until(
        "the event",
        "document.getElementById('events').innerText.includes('left_x is locked: excessive force')",
    );

    let lines = "[...document.querySelectorAll('#frames-lines span')].map((line) => line.innerText)";
    browser.until("the movement", &format!("{lines}.some((line) => line.includes('Move +1234'))"));
    let filter = "(() => { const field = document.getElementById('filter-text'); field.value = 'mOVE +';
        field.dispatchEvent(new Event('input')); })()";
    browser.evaluate(filter);
    let only = format!("{lines}.length === 1 && {lines}[0].includes('Move +1234')");
    browser.until("only the movement", &only);
    let other = "(() => { const field = document.getElementById('filter-axis'); field.value = '2';
        field.dispatchEvent(new Event('input')); })()";
    browser.evaluate(other);
    browser.until("no movement of axis 2", &format!("{lines}.length === 0"));

    // Nothing may be wider than the page, in either size.
    let fits = "document.documentElement.scrollWidth <= innerWidth";
    browser.until("no horizontal scroll", fits);
    browser.looks(400, 800, false);
    browser.until("no horizontal scroll on a telephone", &format!("innerWidth === 400 && {fits}"));

    assert_eq!(browser.errors(), Vec::<String>::new());
    let requests = browser.requests();
    assert!(requests.len() > 5, "{requests:?}");
    assert!(requests.iter().all(|request| request.starts_with(&url)), "{requests:?}");
    cell.ccu("down").done();
    browser.until("that it is down", "document.body.dataset.state === 'down'");
    browser.until("why", "document.getElementById('state-text').innerText.includes('no set named')");
    let (config, log) = (cell.config(), cell.path("again.mcap"));
    cell.ccu(&format!("up --detach --config {} --log {}", config.display(), log.display())).done();
    browser.until("that it is back", CONNECTED);
    browser.until("a new picture", &axis(7, "[data-position=unknown]"));
    end(server);
    assert_eq!(cell.down(), None);
}

#[test]
fn orders_are_given_with_the_token_that_was_printed() {
    let Some(mut browser) = Browser::start() else { return };
    let cell = Cell::new(EXE);
    let _ = cell.up("20");
    let (server, url) = serve(&cell, "--control");
    let (page, token) = url.split_once("#token=").expect("a token was made");
    browser.looks(1280, 800, false);
    browser.open(page);
    browser.until("the question for the token", "!document.getElementById('token').hidden");
    browser.evaluate(&format!(
        "(() => {{ document.getElementById('token-field').value = '{token}';
        document.querySelector('#token button').click(); }})()"
    ));
    browser.until("seven axes that are connected", CONNECTED);
    browser.open("about:blank");
    browser.open(&url);
    browser.until("seven axes that are connected", CONNECTED);
    assert_eq!(browser.evaluate("location.hash"), "", "the token stays out of the history");

    let choose = "(() => { document.getElementById('order-axis').value = '7'; })()";
    browser.until("axes to choose from", "document.getElementById('order-axis').options.length === 8");
    browser.evaluate(choose);
    browser.evaluate("document.querySelector('[data-order=origin]').click()");
    browser.until("the origin", "document.getElementById('told').innerText === 'origin: done'");
    let order = "(() => { document.getElementById('move-how').value = 'to';
        document.getElementById('move-steps').value = '5000'; document.getElementById('move-speed').value = '700';
        document.querySelector('#move button').click(); })()";
    browser.evaluate(order);
    browser.until("that it moves", &axis(7, "[data-activity=cruising]"));
    browser.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', { key: 'Escape' }))");
    browser.until("that it stands", &axis(7, "[data-activity=standing]"));
    let halted = cell.axis("wrist")["position"].as_i64().expect("it is known");
    assert!(0 < halted && halted < 5000, "{halted}");
    browser.evaluate("document.querySelector('[data-order=resume]').click()");
    browser.until("the rest", &axis(7, "[data-position=\"5000\"][data-activity=standing]"));
    browser.evaluate("document.querySelector('#outputs [data-line=screwdriver]').click()");
    browser.until("the output", "document.querySelector('[data-line=screwdriver]').dataset.on === 'true'");
    browser.evaluate("document.querySelector('[data-order=brake]').click()");
    browser.until("a lock", &axis(3, "[data-alarm=braked]"));
    browser.evaluate(&order.replace("5000", "100"));
    browser.until("a refusal", "document.getElementById('told').dataset.how === 'bad'");
    let told = browser.evaluate("document.getElementById('told').innerText");
    assert!(told.as_str().is_some_and(|told| told.contains("wrist")), "{told}");
    end(server);
    let _ = cell.down();
}

/// The pictures of the book: `cargo test -p supersigma-ccu --test browser -- --ignored`.
#[test]
#[ignore = "writes docs/src/images"]
fn pictures() {
    let mut browser = Browser::start().expect("pictures need Chromium");
    let cell = Cell::new(EXE);
    let _ = cell.up("1");
    let (server, url) = serve(&cell, "--control");
    browser.looks(1280, 800, true);
    browser.open(&url);
    browser.until("seven axes that are connected", CONNECTED);
    cell.ccu("origin").done();
    cell.ccu("output lamp on").done();
    cell.ccu("output left_gripper on").done();
    cell.ccu("line left_x=21000 left_y=13000 left_z=9000").done();
    cell.ccu("move right_z 2000").done();
    cell.ccu("inject right_z force").done();
    cell.ccu("move right_y 15000 --no-wait").done();
    cell.ccu("move wrist 3000 --no-wait --speed 2500").done();
    cell.ccu("line left_x=-9000 left_y=9000").done();
    cell.ccu("move right_x 60000 --no-wait").done();
    cell.ccu("move left_x 40000 --no-wait --speed 6000").done();
    browser.until(
        "well on its way",
        "Number(document.querySelector('[data-axis=\"4\"]').dataset.position) > 20000",
    );
    let images = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/src/images");
    std::fs::create_dir_all(&images).expect("a folder");
    browser.picture(&images.join("serve.png"));
    browser.looks(1280, 800, false);
    browser.until("light", "matchMedia('(prefers-color-scheme: light)').matches");
    browser.evaluate("new Promise((drawn) => setTimeout(drawn, 200))");
    browser.picture(&images.join("serve-light.png"));
    browser.looks(400, 800, true);
    browser.evaluate("new Promise((drawn) => setTimeout(drawn, 200))");
    browser.picture(&images.join("serve-narrow.png"));
    end(server);
    let _ = cell.down();
}
