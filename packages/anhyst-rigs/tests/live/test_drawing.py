"""Test how the page draws: complete bins are kept, and a picture that has not changed is not drawn again."""

from __future__ import annotations

import pytest

from tests.live.conftest import Served, Show
from tests.live.test_page import ready, seen, until

pytestmark = pytest.mark.needs("chromium")

COMPARE = """async () => {
  const { Bins, Store } = await import("/assets/store.js");
  const store = new Store(2, 1, 20000); // smaller than the number of samples, so that rows are dropped
  const known = new Bins();
  const size = (n) => ((n * 7919) % 10007) - 5000;
  let compared = 0;
  const differing = [];
  for (let first = 1; first < 60000; first += 333) {
    const n = first % 4 ? 333 : 300; // sometimes ticks are missing
    store.push({
      first, last: first + n - 1,
      ticks: Float64Array.from({ length: n }, (_, i) => first + i),
      data: [0, 1].map((k) => Float32Array.from({ length: n }, (_, i) => size(first + i + k))),
    });
    for (const window of [5000, 15000]) {
      const given = [[0, 1], store.newest - window, store.newest, 300];
      const kept = store.envelope(...given, known);
      const { width } = known;
      const fresh = new Bins();
      fresh.fit(width, 602);
      const expected = store.envelope(...given, fresh);
      compared += kept.ticks.length;
      const same = (name) => String(kept[name]) === String(expected[name]);
      if (fresh.width !== width || !same("ticks") || !same("columns"))
        differing.push([first, window]);
    }
  }
  return [compared, differing];
}"""


def test_kept_bins_have_the_extremes_of_all_their_rows(bearing: Served, show: Show) -> None:
    page = show(bearing)
    ready(page)
    compared, differing = page.evaluate(COMPARE)
    assert compared > 100_000
    assert differing == []


def test_a_picture_is_drawn_again_only_if_it_has_changed(bearing: Served, show: Show) -> None:
    page = show(bearing)
    ready(page)
    page.evaluate(
        "window.drawn = 0; anhyst.scope.plot.strips[0].plot.hooks.draw.push(() => (window.drawn += 1))"
    )
    until(page, "window.drawn > 10")
    bearing.session.pacer.pause()
    page.wait_for_timeout(300)
    before = seen(page, "window.drawn")
    page.wait_for_timeout(500)
    assert seen(page, "window.drawn") == before
    page.locator("#scope .u-over").first.click(position={"x": 100, "y": 10})  # a cursor changes the picture
    until(page, f"window.drawn > {before}")
    bearing.session.pacer.resume()
