// Scores of Sphinx's search. Where words match equally well, pages of the guide that explain come first.
const LISTS = ["index", "tasks", "changes"];
var Scorer = {
  score: ([page, title, anchor, description, score]) => (page.includes("/") || LISTS.includes(page) ? score : score + 1),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
