/**
 * Markup and style inside the custom element. A constructed sheet, because the content security policy of the page
 * forbids inline style.
 */

export const template = document.createElement('template');
template.innerHTML = `
  <canvas part="canvas" tabindex="0" role="application" aria-roledescription="3D view" aria-describedby="help"></canvas>
  <p id="help" class="unseen">Arrow keys orbit, Shift and arrows pan, plus and minus move closer and away, Home returns to
    the first viewpoint, digits go to viewpoints, F flies with W A S D Q E.</p>
  <i class="marker" part="marker" hidden></i>
  <div class="mode inspecting" part="mode">Inspecting: choose a point<span class="keys">, <kbd>Enter</kbd> the centre, <kbd>Esc</kbd> ends</span></div>
  <div class="mode flying" part="mode" hidden>Flying: <kbd>W</kbd><kbd>A</kbd><kbd>S</kbd><kbd>D</kbd> move, <kbd>Q</kbd><kbd>E</kbd> down and up, <kbd>F</kbd> ends</div>
  <div class="card" part="status" hidden>
    <div class="words"><strong></strong><span></span></div>
    <button type="button" hidden></button>
  </div>
  <p class="unseen live" role="status" aria-live="polite"></p>
  <p class="unseen direction" aria-live="polite"></p>
`;

export const sheet = new CSSStyleSheet();
sheet.replaceSync(`
  :host {
    display: block; position: relative; overflow: hidden; contain: content; aspect-ratio: 16 / 9;
    background: #0c0d0f; color: #f2f3f5;
    font: 13px/1.4 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif;
  }
  :host([hidden]) { display: none; }
  canvas {
    display: block; width: 100%; height: 100%; object-fit: cover;
    touch-action: none; user-select: none; -webkit-user-select: none; outline: none; cursor: grab;
  }
  canvas:active { cursor: grabbing; }
  :host([inspecting]) canvas { cursor: crosshair; }
  .marker {
    position: absolute; width: 15px; height: 15px; margin: -9.5px; border: 2px solid #fff; border-radius: 50%;
    box-shadow: 0 0 0 1px #000, inset 0 0 0 1px #000; pointer-events: none;
  }
  canvas:focus-visible { outline: 2px solid #6cb6ff; outline-offset: -2px; }
  .card {
    position: absolute; left: 50%; bottom: 56px; transform: translateX(-50%);
    box-sizing: border-box; width: max-content; max-width: min(420px, calc(100% - 32px));
    display: flex; align-items: center; gap: 16px; padding: 12px 16px;
    border-radius: 10px; background: rgb(24 26 30 / .92); border: 1px solid rgb(255 255 255 / .12);
    box-shadow: 0 8px 28px rgb(0 0 0 / .35);
  }
  .card.centred { bottom: auto; top: 50%; transform: translate(-50%, -50%); }
  .card[hidden], .mode[hidden], .marker[hidden], button[hidden] { display: none; }
  .words { display: grid; gap: 2px; }
  .words strong { font-weight: 600; }
  .words span { color: #b9bec7; font-variant-numeric: tabular-nums; }
  button {
    flex: none; font: inherit; font-weight: 550; color: #0b1a2b; background: #8cc4ff; border: 0;
    border-radius: 7px; min-height: 32px; padding: 0 14px; cursor: pointer;
  }
  button:hover { background: #a9d3ff; }
  button:focus-visible { outline: 2px solid #fff; outline-offset: 2px; }
  .mode {
    position: absolute; left: 50%; top: 12px; transform: translateX(-50%); white-space: nowrap;
    padding: 6px 12px; border-radius: 999px; background: rgb(24 26 30 / .88); border: 1px solid rgb(255 255 255 / .12);
    font-size: 12px; color: #d5d9e0; pointer-events: none;
  }
  :host(:not([inspecting])) .inspecting, .inspecting:has(~ .flying:not([hidden])) { display: none; }
  @media (hover: none) and (pointer: coarse) { .keys { display: none; } }
  kbd {
    font: inherit; font-size: 11px; padding: 0 5px; margin: 0 1px; border-radius: 4px;
    border: 1px solid rgb(255 255 255 / .22); background: rgb(255 255 255 / .08);
  }
  .unseen { position: absolute; width: 1px; height: 1px; margin: -1px; overflow: hidden; clip-path: inset(50%); white-space: nowrap; }
`);
