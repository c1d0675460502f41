// Names and notes come from outside. A control character, an invisible mark or a turn of direction is shown as its code,
// as `glapp.escape` shows it on a terminal: here for every text that comes into a page, whoever puts it there.
{
  const hidden = /(?![\t\n\r])[\p{Cc}\p{Cf}\p{Cs}\p{Zl}\p{Zp}]/gu;
  const named = ["title", "aria-label"];
  const hex = (n, digits) => n.toString(16).padStart(digits, "0");
  const code = (char) => {
    const n = char.codePointAt(0);
    return n < 0x100 ? `\\x${hex(n, 2)}` : n < 0x10000 ? `\\u${hex(n, 4)}` : `\\U${hex(n, 8)}`;
  };
  const of_text = (node) => {
    if (node.data.search(hidden) < 0 || ["SCRIPT", "STYLE", "TEXTAREA"].includes(node.parentNode?.nodeName)) return;
    node.data = node.data.replace(hidden, code);
  };
  const of_name = (node, name) => {
    const text = node.getAttribute(name);
    if (text !== null && text.search(hidden) >= 0) node.setAttribute(name, text.replace(hidden, code));
  };
  const of_all = (root) => {
    if (root.nodeType === Node.TEXT_NODE) return of_text(root);
    const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT | NodeFilter.SHOW_ELEMENT);
    for (let node = root; node; node = walker.nextNode()) {
      if (node.nodeType === Node.TEXT_NODE) of_text(node);
      else if (node.nodeType === Node.ELEMENT_NODE) named.forEach((name) => of_name(node, name));
    }
  };
  of_all(document.documentElement);
  new MutationObserver((changes) => {
    for (const change of changes) {
      if (change.type === "characterData") of_text(change.target);
      else if (change.type === "attributes") of_name(change.target, change.attributeName);
      else change.addedNodes.forEach(of_all);
    }
  }).observe(document.documentElement, { subtree: true, childList: true, characterData: true, attributeFilter: named });
}
