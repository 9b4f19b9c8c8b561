/**
 * Contrast of displayed text, by the formula of WCAG.
 */

/**
 * Text whose contrast with its background is less than 4.5 to 1.
 * @param {import('playwright-core').Page} page
 * @param {string} selector of the elements; hidden and disabled ones are skipped
 */
export function poorContrast(page, selector) {
  return page.evaluate((wanted) => {
    const parse = (text) => text.match(/[\d.]+/g).map(Number);
    const luminance = ([r, g, b]) =>
      [r, g, b].reduce((sum, part, i) => {
        const c = part / 255;
        return sum + [0.2126, 0.7152, 0.0722][i] * (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
      }, 0);
    const background = (element) => {
      for (let at = element; at; at = at.parentElement) {
        const [r, g, b, a = 1] = parse(getComputedStyle(at).backgroundColor);
        if (a > 0.5) return [r, g, b];
      }
      return [255, 255, 255];
    };
    return [...document.querySelectorAll(wanted)]
      .filter((element) => element.checkVisibility() && [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim()))
      .filter((element) => !element.closest(':disabled'))
      .map((element) => {
        const [a, b] = [luminance(parse(getComputedStyle(element).color)), luminance(background(element))];
        const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        return { text: element.textContent.trim().slice(0, 30), contrast };
      })
      .filter(({ contrast }) => contrast < 4.5);
  }, selector);
}
