#define NAME_@CALL@ @size@u

/* The present weights of '@of@': mantissas by source, then target. Save them, and restore them after name_init(). */
@kind@ *name_@call@(void);

