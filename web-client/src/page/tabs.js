/**
 * The panels on a small screen: a sheet at the lower edge with one panel at a time, closed to its tabs at first.
 * On a wide screen the style sheet shows all panels and hides the tabs.
 */

/**
 * @param {HTMLElement} sheet with `[data-tab]` buttons and `[data-panel]` sections
 * @returns {(name: string) => void} opens a panel, if the tabs are shown
 */
export function wireTabs(sheet) {
  /** @type {NodeListOf<HTMLButtonElement>} */
  const tabs = sheet.querySelectorAll('[data-tab]');
  /** @type {NodeListOf<HTMLElement>} */
  const panels = sheet.querySelectorAll('[data-panel]');

  /** @param {string} name empty closes the sheet */
  const open = (name) => {
    sheet.dataset['open'] = name;
    for (const tab of tabs) tab.setAttribute('aria-expanded', String(tab.dataset['tab'] === name));
    for (const panel of panels) panel.classList.toggle('current', panel.dataset['panel'] === name);
  };

  for (const tab of tabs) {
    tab.addEventListener('click', () => open(sheet.dataset['open'] === tab.dataset['tab'] ? '' : (tab.dataset['tab'] ?? '')));
  }
  sheet.addEventListener('keydown', (event) => {
    if (event.key === 'Escape' && sheet.dataset['open']) {
      open('');
      tabs[0]?.focus();
    }
  });
  open('');
  return (name) => {
    if (tabs[0]?.checkVisibility()) open(name);
  };
}
