// What the browser keeps for the page; where it is told to keep nothing, the page goes on without.

const at = (area, act) => { try { return act(window[area]); } catch { return null; } };

export const kept = (name, area = "localStorage") => at(area, (store) => store.getItem(name));
export const keep = (name, value, area = "localStorage") => at(area, (store) => store.setItem(name, value));
