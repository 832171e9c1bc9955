#define NAME_@CALL@_ONE @one@ /* stands for 1/ms */

/* Set signal @signal@ after a step, for each of the @size@ neurons of '@to@': it acts from the next step on, and decays. */
void name_@call@(const int32_t *values);

