/* The engine has macros of its own for sizes, and other names of the model follow: keep them as numbers. */
enum { ENGINE_N_X = N_X };
#undef N_X
#undef N_Z
#undef N_M
#undef N_W
#undef N_P
#undef N_G
#undef N_Y
#undef STOP
#undef CHATTER
#undef ROUNDS
#undef EVALUATE
