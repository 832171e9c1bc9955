#define NAME_@CALL@ @size@u

/* The weights of '@of@' as they are now, mantissas by source, then target: to be kept, and put back after name_init(). */
@kind@ *name_@call@(void);

